// Reads an MCAP file with @mcap/core and prints what it holds as JSON.
// usage: node read_mcap.mjs NODE_MODULES FILE
import { open } from "node:fs/promises";
import { createRequire } from "node:module";
import { join } from "node:path";

const [modules, path] = process.argv.slice(2);
const { McapIndexedReader, McapStreamReader } = createRequire(import.meta.url)(join(modules, "@mcap/core"));
const text = new TextDecoder("utf-8", { fatal: true });
const file = await open(path);
const { size } = await file.stat();

async function read(offset, length) {
  const bytes = new Uint8Array(Number(length));
  await file.read(bytes, 0, bytes.length, Number(offset));
  return bytes;
}

class Channels {
  schemas = new Map();
  topics = new Map();

  addSchema(schema) {
    this.schemas.set(schema.id, { ...schema, json: JSON.parse(text.decode(schema.data)) });
  }

  addChannel({ id, schemaId, topic, messageEncoding }) {
    const { name, encoding, json } = this.schemas.get(schemaId);
    this.topics.set(id, {
      topic, messageEncoding, schema: name, schemaEncoding: encoding, required: json.required, messages: 0, last: null,
    });
  }

  addMessage({ channelId, data }) {
    const channel = this.topics.get(channelId);
    const message = JSON.parse(text.decode(data));
    const missing = channel.required.filter((field) => !(field in message));
    if (missing.length > 0) throw new Error(`${channel.topic}: message ${channel.messages} lacks ${missing}`);
    channel.messages += 1;
    channel.last = message;
  }
}

async function streamed() {
  const reader = new McapStreamReader({ validateCrcs: true });
  const channels = new Channels();
  reader.append(await read(0, size));
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Schema") channels.addSchema(record);
    else if (record.type === "Channel" && !channels.topics.has(record.id)) channels.addChannel(record);
    else if (record.type === "Message") channels.addMessage(record);
  }
  return { complete: reader.done(), channels: [...channels.topics.values()] };
}

async function indexed() {
  const readable = { size: async () => BigInt(size), read };
  const reader = await McapIndexedReader.Initialize({ readable });
  const channels = new Channels();
  for (const schema of reader.schemasById.values()) channels.addSchema(schema);
  for (const channel of reader.channelsById.values()) channels.addChannel(channel);
  for await (const message of reader.readMessages({ validateCrcs: true })) channels.addMessage(message);
  const metadata = {};
  for await (const record of reader.readMetadata()) metadata[record.name] = Object.fromEntries(record.metadata);
  const attachments = {};
  for await (const record of reader.readAttachments()) attachments[record.name] = text.decode(record.data);
  return { channels: [...channels.topics.values()], metadata, attachments };
}

const result = await streamed();
console.log(JSON.stringify({ streamed: result, indexed: result.complete ? await indexed() : null }));
await file.close();
