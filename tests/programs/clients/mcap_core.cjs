// Reads or writes MCAP files with @mcap/core: the part of other_readers.py that runs in Node.
//
//     node mcap_core.cjs read FILE...            prints a line a file: {topic: [[log time, CRC-32 of the data], ...]}: by the index,
//                                             or as a stream where that fails
//     node mcap_core.cjs write OPTIONS IN OUT    writes the channels and messages of a JSON file
//
// The packages @mcap/core, @mcap/support and @mcap/nodejs are looked for below the folder MCAP_CORE.
const fs = require("node:fs");
const path = require("node:path");

const { createRequire } = require("node:module");
const find = createRequire(path.join(process.env.MCAP_CORE, "package.json"));
const { McapIndexedReader, McapStreamReader, McapWriter } = find("@mcap/core");
const { FileHandleReadable, FileHandleWritable } = find("@mcap/nodejs");
const { loadDecompressHandlers } = find("@mcap/support");
const { crc32 } = find("@foxglove/crc");

async function indexed(file, decompressHandlers) {
  const found = {};
  const handle = await fs.promises.open(file);
  try {
    const reader = await McapIndexedReader.Initialize({ readable: new FileHandleReadable(handle), decompressHandlers });
    if (!reader.chunkIndexes.length || reader.chunkIndexes.some((one) => !one.messageIndexOffsets.size)) {
      return undefined; // it would find nothing there
    }
    for await (const message of reader.readMessages()) {
      keep(found, reader.channelsById.get(message.channelId), message);
    }
    return found;
  } catch {
    return undefined;
  } finally {
    await handle.close();
  }
}

function streamed(file, decompressHandlers) {
  const found = {};
  const channels = new Map();
  const reader = new McapStreamReader({ decompressHandlers });
  reader.append(fs.readFileSync(file));
  for (let record; (record = reader.nextRecord()); ) {
    if (record.type === "Channel") {
      channels.set(record.id, record);
    } else if (record.type === "Message") {
      keep(found, channels.get(record.channelId), record);
    }
  }
  return found;
}

function keep(found, channel, message) {
  (found[channel.topic] ??= []).push([String(message.logTime), crc32(message.data)]);
}

async function write(options, source, file) {
  const { channels, messages } = JSON.parse(fs.readFileSync(source, "utf8"));
  const handle = await fs.promises.open(file, "w");
  const writer = new McapWriter({ writable: new FileHandleWritable(handle), ...options });
  await writer.start({ profile: "", library: "other" });
  const ids = [];
  for (const { topic, encoding, schema } of channels) {
    const schemaId = schema
      ? await writer.registerSchema({ name: schema[0], encoding: schema[1], data: Buffer.from(schema[2], "base64") })
      : 0;
    ids.push(await writer.registerChannel({ topic, messageEncoding: encoding, schemaId, metadata: new Map() }));
  }
  for (const [k, time, data] of messages) {
    const logTime = BigInt(time);
    await writer.addMessage({
      channelId: ids[k], sequence: 0, logTime, publishTime: logTime, data: Buffer.from(data, "base64"),
    });
  }
  await writer.end();
  await handle.close();
}

async function main([command, ...rest]) {
  if (command === "write") {
    await write(JSON.parse(rest[0]), rest[1], rest[2]);
    return;
  }
  const handlers = await loadDecompressHandlers();
  for (const file of rest) {
    console.log(JSON.stringify((await indexed(file, handlers)) ?? streamed(file, handlers)));
  }
}

main(process.argv.slice(2));
