// Times the page's kernels under Node: node speed.js FOLDER < cases.json > microseconds of a call, by policy
"use strict";
const fs = require("node:fs");
const path = require("node:path");
const vm = require("node:vm");

const folder = process.argv[2];
const sources = ["data.js", "kernels.js", "simulator.js", "pilots.js"].map((name) => fs.readFileSync(path.join(folder, name), "utf8"));
vm.runInThisContext(`${sources.join("\n")}\nglobalThis.page = { Kernels, Simulator, pilotFor };`);
const { Kernels, Simulator, pilotFor } = globalThis.page;

async function main() {
  const tables = JSON.parse(fs.readFileSync(path.join(folder, "kernels.json"), "utf8"));
  const kernels = await Kernels.load(fs.readFileSync(path.join(folder, "kernels.wasm")), tables);
  const found = {};
  for (const { world, robot, actuators, policy, calls, rounds } of JSON.parse(fs.readFileSync(0, "utf8"))) {
    const simulator = new Simulator(kernels, world, { robot, actuators });
    simulator.reset();
    const pilot = pilotFor(simulator, policy);
    pilot.act();
    let least = Infinity;
    for (let round = 0; round < rounds; round++) {
      const begun = process.hrtime.bigint();
      for (let k = 0; k < calls; k++) kernels.call(pilot.recipe.export, pilot.values);
      least = Math.min(least, Number(process.hrtime.bigint() - begun) / 1e3 / calls);
    }
    found[policy] = least;
    simulator.free();
  }
  process.stdout.write(JSON.stringify(found));
}
main();
