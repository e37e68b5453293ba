// A client of the Foxglove WebSocket, by the protocol's own npm package: what it sees goes to stdout as JSON.
// Arguments: the URL, and the folder that holds node_modules.
import { createRequire } from "node:module";
const require = createRequire(process.argv[3] + "/");
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const WebSocket = require("ws");

const seen = { subprotocols: [], channels: {}, messages: {}, values: {}, services: [], answers: {}, errors: [] };
const socket = new WebSocket(process.argv[2], ["foxglove.sdk.v1"]);
const client = new FoxgloveClient({ ws: socket });
const topics = new Map();
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
const calls = new Map();

client.on("error", (error) => seen.errors.push(String(error)));
client.on("serverInfo", (info) => (seen.capabilities = info.capabilities));
client.on("advertise", (channels) => {
  for (const channel of channels) {
    seen.channels[channel.topic] = { encoding: channel.encoding, schemaName: channel.schemaName, schemaEncoding: channel.schemaEncoding };
    topics.set(client.subscribe(channel.id), channel.topic);
  }
});
client.on("advertiseServices", (services) => {
  for (const service of services) {
    seen.services.push(service.name);
    calls.set(service.name, service.id);
  }
});
client.on("message", ({ subscriptionId, data }) => {
  const topic = topics.get(subscriptionId);
  seen.messages[topic] = (seen.messages[topic] ?? 0) + 1;
  if (seen.channels[topic].schemaName === "std_msgs/msg/Float64") seen.values[topic] = data.getFloat64(4, true);
});
client.on("serviceCallResponse", (answer) => (seen.answers[answer.callId] = JSON.parse(new TextDecoder().decode(answer.data))));
client.on("serviceCallFailure", (answer) => (seen.answers[answer.callId] = answer));

function call(name, id, request) {
  client.sendServiceCallRequest({ serviceId: calls.get(name), callId: id, encoding: "json", data: new DataView(new TextEncoder().encode(JSON.stringify(request)).buffer) });
}

client.on("open", async () => {
  seen.subprotocol = socket.protocol;
  await pause(500);
  const json = client.advertise({ topic: "/joint_1/equilibrium_position", encoding: "json", schemaName: "std_msgs/msg/Float64" });
  const cdr = client.advertise({ topic: "/joint_2/equilibrium_position", encoding: "cdr", schemaName: "std_msgs/msg/Float64" });
  for (let i = 1; i <= 100; i++) {
    client.sendMessage(json, new TextEncoder().encode(JSON.stringify({ data: i / 1000 })));
    const bytes = new DataView(new ArrayBuffer(12));
    bytes.setUint8(1, 1);
    bytes.setFloat64(4, -i / 1000, true);
    client.sendMessage(cdr, new Uint8Array(bytes.buffer));
    await pause(5);
  }
  for (const nonsense of ["{", '{"data": "x"}', '{"other": 1}', "[]"]) client.sendMessage(json, new TextEncoder().encode(nonsense));
  client.sendMessage(cdr, new Uint8Array([0, 1, 0]));
  await pause(300);
  call("/asrsim/pause", 1, { data: true });
  await pause(200);
  call("/asrsim/pause", 3, { data: false });
  call("/asrsim/pause", 4, { data: "perhaps" });
  await pause(400);
  console.log(JSON.stringify(seen));
  process.exit(0);
});
setTimeout(() => { console.log(JSON.stringify(seen)); process.exit(1); }, 20000);
