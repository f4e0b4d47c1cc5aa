// Drives the page's own simulator under Node: node page_runner.js FOLDER < cases.json > results.json
"use strict";
const fs = require("node:fs");
const path = require("node:path");
const vm = require("node:vm");

const folder = process.argv[2];
const sources = ["data.js", "kernels.js", "simulator.js", "pilots.js"].map((name) => fs.readFileSync(path.join(folder, name), "utf8"));
vm.runInThisContext(`${sources.join("\n")}\nglobalThis.page = { Kernels, Simulator, pilotFor, pilotsOf };`);
const { Kernels, Simulator, pilotFor } = globalThis.page;

async function main() {
  const tables = JSON.parse(fs.readFileSync(path.join(folder, "kernels.json"), "utf8"));
  const kernels = await Kernels.load(fs.readFileSync(path.join(folder, "kernels.wasm")), tables);
  const results = [];
  for (const { world, robot, actuators, policy, steps, places } of JSON.parse(fs.readFileSync(0, "utf8"))) {
    try {
      const simulator = new Simulator(kernels, world, { robot, actuators });
      simulator.reset();
      const pilot = pilotFor(simulator, policy);
      const placed = () => [...simulator.pose, ...simulator.others.flat()];
      const poses = [placed()];
      const begun = process.hrtime.bigint();
      let flags = { ended: false };
      for (let k = 0; k < steps && !flags.ended; k++) {
        flags = simulator.step(pilot.act());
        poses.push(placed());
      }
      const seconds = Number(process.hrtime.bigint() - begun) / 1e9;
      const looked = places && (pilot.look ? pilot.look(places) : [pilot.act(), pilot.wanted].flat());
      results.push({ looked: looked && Buffer.from(new Float64Array(looked).buffer).toString("base64"), poses: Buffer.from(new Float64Array(poses.flat()).buffer).toString("base64"), flags, seconds });
      simulator.free();
    } catch (error) {
      results.push({ error: String(error.stack || error) });
    }
  }
  process.stdout.write(JSON.stringify(results));
}
main();
