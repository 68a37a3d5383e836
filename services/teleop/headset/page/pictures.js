// Stereo pictures: taken apart, decoded in a worker, handed out in order, the newest one kept.

export class Pictures {
  /** @param {(picture: {header: object, left: ImageBitmap, right: ImageBitmap}) => void} onDecoded
   *  @param {(header: object) => void} onFailed */
  constructor(onDecoded, onFailed) {
    this.worker = new Worker(new URL("decoder.js", import.meta.url));
    this.newest = 0;
    this.worker.onmessage = ({ data }) => {
      if (data.error) return onFailed(data.header);
      // Two are decoded at once; an older one that is ready later is not shown any more.
      if (data.header.number < this.newest) {
        data.left.close();
        data.right.close();
        return onFailed(data.header);
      }
      this.newest = data.header.number;
      onDecoded(data);
    };
  }

  /** Take in a binary message of the server, received at `at` by the page's clock [ms]. */
  receive(buffer, at) {
    const length = new DataView(buffer).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    header.at = at;
    const start = 4 + length, middle = start + header.left;
    const left = buffer.slice(start, middle), right = buffer.slice(middle);
    this.worker.postMessage({ header, left, right }, [left, right]);
  }

  /** Begin anew, for a server that may count pictures from the start again. */
  restart() { this.newest = 0; }
}
