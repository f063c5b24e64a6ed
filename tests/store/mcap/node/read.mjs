// Prints the messages, metadata and attachments of a trace file as one JSON object. Numbers that
// JSON lacks are printed as strings.

import { open } from "node:fs/promises";
import { McapIndexedReader } from "@mcap/core";
import { decompress } from "fzstd";
import protobuf from "protobufjs";
import "protobufjs/ext/descriptor.js";

const file = await open(process.argv[2]);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const buffer = new Uint8Array(Number(length));
    const { bytesRead } = await file.read(buffer, 0, buffer.length, Number(offset));
    if (bytesRead !== buffer.length) throw new Error(`${length} bytes asked, ${bytesRead} read`);
    return buffer;
  },
};
const reader = await McapIndexedReader.Initialize({
  readable,
  decompressHandlers: { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) },
});

const types = new Map();
for (const [id, schema] of reader.schemasById) {
  if (schema.encoding === "protobuf") {
    types.set(id, protobuf.Root.fromDescriptor(schema.data).lookupType(schema.name));
  }
}

const decode = (schemaId, data) => {
  const type = types.get(schemaId);
  if (type === undefined) return JSON.parse(new TextDecoder().decode(data));
  return type.toObject(type.decode(data), { defaults: true, enums: String, longs: Number });
};

const messages = [];
for await (const { channelId, logTime, data } of reader.readMessages()) {
  const { topic, schemaId } = reader.channelsById.get(channelId);
  messages.push({ topic, time: logTime.toString(), message: decode(schemaId, data) });
}
const attachments = {};
for await (const { name, data } of reader.readAttachments()) {
  attachments[name] = new TextDecoder().decode(data);
}
const metadata = {};
for await (const record of reader.readMetadata()) {
  metadata[record.name] = Object.fromEntries(record.metadata);
}
await file.close();

const nameable = (_, value) =>
  typeof value === "number" && (!Number.isFinite(value) || Object.is(value, -0))
    ? Object.is(value, -0) ? "-0" : String(value)
    : value;
console.log(JSON.stringify({ messages, attachments, metadata }, nameable));
