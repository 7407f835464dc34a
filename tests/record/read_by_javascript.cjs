// Reads a recording with nothing of ours: the mcap library for JavaScript, and the schemas inside.
// Prints, as JSON, how many messages each topic has and the ENF of each estimate.
"use strict";
const { open } = require("node:fs/promises");
const { McapIndexedReader } = require("@mcap/core");
const { FileHandleReadable } = require("@mcap/nodejs");
const { loadDecompressHandlers } = require("@mcap/support");
const protobuf = require("protobufjs");
const { FileDescriptorSet } = require("protobufjs/ext/descriptor");

async function main(path) {
  const readable = new FileHandleReadable(await open(path));
  const decompressHandlers = await loadDecompressHandlers();
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const types = new Map();
  for (const { id, name, data } of reader.schemasById.values()) {
    types.set(id, protobuf.Root.fromDescriptor(FileDescriptorSet.decode(data)).lookupType(name));
  }
  const messages = {};
  const enf_hz = [];
  for await (const { channelId, data } of reader.readMessages()) {
    const { topic, schemaId } = reader.channelsById.get(channelId);
    messages[topic] = (messages[topic] ?? 0) + 1;
    const message = types.get(schemaId).decode(data);
    if (topic.endsWith("/track") && message.points > 0) enf_hz.push(message.enf_hz);
  }
  process.stdout.write(JSON.stringify({ messages, enf_hz }));
}

main(process.argv[2]);
