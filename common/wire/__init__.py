"""The bytes of a message: codec, header, schema identity, sequence numbers. No Zenoh here."""
