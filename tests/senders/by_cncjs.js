// A job by cncjs: its server has the port, and this says to the server what its web page would say.
const assert = require("assert");
const fs = require("fs");
const path = require("path");
const { spawn } = require("child_process");
const io = require("socket.io-client");
const jwt = require("jsonwebtoken");

const [port, job] = process.argv.slice(2);
const config = path.resolve("cncrc");
fs.writeFileSync(config, JSON.stringify({ secret: "rig" }));
const program = path.join(path.dirname(require.resolve("cncjs/package.json")), "bin/cncjs");
const server = spawn(process.execPath, [program, "--host", "127.0.0.1", "--port", "0", "--config", config]);
process.on("exit", () => server.kill());
server.stderr.pipe(process.stderr);
let said = "";
server.stdout.on("data", (data) => {
  said += data;
  const [address] = /http:\/\/127\.0\.0\.1:\d+/.exec(said) || [];
  if (address) {
    server.stdout.removeAllListeners("data").resume();
    stream(address);
  }
});

function stream(address) {
  const page = io(address, { query: "token=" + jwt.sign({ id: "", name: "page" }, "rig") });
  const command = (...words) => page.emit("command", port, ...words);
  const seen = new Set();
  let loaded = false;
  page.on("connect", () => page.emit("open", port, { baudrate: 115200, controllerType: "Grbl" }, assert.ifError));
  page.on("serialport:read", (line) => assert(!/^(error|ALARM)/.test(line), line));
  page.on("controller:state", (_, { status }) => {
    seen.add(status.activeState);
    if (!loaded && seen.has("Idle")) {
      loaded = true;
      command("gcode:load", "shoulder", fs.readFileSync(job, "utf8"), {}, (error) => {
        assert.ifError(error);
        command("gcode:start");
      });
    } else if (seen.has("Run") && status.activeState === "Idle") {
      assert.deepStrictEqual(status.mpos, { x: "0.356", y: "0.000", z: "1.000" });
      process.exit();
    }
  });
}
