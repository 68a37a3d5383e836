// Worker: decodes stereo pictures off the page's main thread.

onmessage = async ({ data: { header, left, right } }) => {
  const decode = (file) => createImageBitmap(new Blob([file], { type: "image/jpeg" }));
  try {
    const [l, r] = await Promise.all([decode(left), decode(right)]);
    postMessage({ header, left: l, right: r }, [l, r]);
  } catch (error) {
    postMessage({ header, error: String(error) });
  }
};
