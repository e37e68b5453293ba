// A client of the Foxglove WebSocket, by the protocol's own npm package: what it sees goes to stdout as JSON.
// Arguments: the URL, and the folder that holds node_modules.
import { createRequire } from "node:module";
const require = createRequire(process.argv[3] + "/");
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const WebSocket = require("ws");

const seen = { channels: {}, messages: {}, errors: [] };
const socket = new WebSocket(process.argv[2], ["foxglove.sdk.v1"]);
const client = new FoxgloveClient({ ws: socket });
const topics = new Map();
const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

client.on("error", (error) => seen.errors.push(String(error)));
client.on("serverInfo", (info) => (seen.capabilities = info.capabilities));
client.on("advertise", (channels) => {
  for (const channel of channels) {
    seen.channels[channel.topic] = { encoding: channel.encoding, schemaName: channel.schemaName, schemaEncoding: channel.schemaEncoding };
    topics.set(client.subscribe(channel.id), channel.topic);
  }
});
client.on("message", ({ subscriptionId }) => {
  const topic = topics.get(subscriptionId);
  seen.messages[topic] = (seen.messages[topic] ?? 0) + 1;
});
const send = (channel, message) => client.sendMessage(channel, new TextEncoder().encode(message));

client.on("open", async () => {
  seen.subprotocol = socket.protocol;
  await pause(500);
  const goal = client.advertise({ topic: "/joint_1/equilibrium_position", encoding: "json", schemaName: "std_msgs/msg/Float64" });
  for (let i = 1; i <= 100; i++) {
    send(goal, JSON.stringify({ data: i / 1000 }));
    await pause(5);
  }
  for (const nonsense of ["{", '{"data": "x"}', '{"other": 1}', "[]", "\u0000\u0001"]) send(goal, nonsense);
  await pause(300);
  console.log(JSON.stringify(seen));
  process.exit(0);
});
setTimeout(() => { console.log(JSON.stringify(seen)); process.exit(1); }, 20000);
