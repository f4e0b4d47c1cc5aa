// The package's own compiled functions, in WebAssembly: memory, and calls by the names of their arguments.

const KINDS = { "<f8": Float64Array, "<i8": BigInt64Array, "<f4": Float32Array };

class Kernels {
  // Reference counts are not kept: what a call asks for is taken away before the next one.
  static async load(bytes, tables) {
    return Kernels.of(await WebAssembly.compile(bytes), tables);
  }

  static async of(module, tables) {
    const kernels = new Kernels(tables);
    const imports = {};
    kernels.module = module;
    for (const { module: room, name, kind } of WebAssembly.Module.imports(module)) {
      if (kind === "function") (imports[room] = imports[room] || {})[name] = kernels.imported(name);
    }
    kernels.instance = await WebAssembly.instantiate(module, imports);
    kernels.memory = kernels.instance.exports.memory;
    kernels.top = kernels.instance.exports.__heap_base.value;
    kernels.scratch = kernels.top;
    return kernels;
  }

  // The same functions with a memory of their own.
  twin() {
    return Kernels.of(this.module, this.tables);
  }

  constructor(tables) {
    this.tables = tables;
    this.plans = new Map();
    this.users = []; // simulators in the order of their room
    this.blobs = tables.blobs.map(() => null);
  }

  imported(name) {
    const known = {
      sqrt: Math.sqrt, floor: Math.floor, ceil: Math.ceil, trunc: Math.trunc, fabs: Math.abs,
      // half to even, as IEEE rounds
      rint: (x) => { const r = Math.round(x); return Math.abs(x % 1) === 0.5 && r % 2 !== 0 ? r - 1 : r; },
      memset: (at, value, size) => { new Uint8Array(this.memory.buffer).fill(value, at, at + Number(size)); return at; },
      memcpy: (to, from, size) => { new Uint8Array(this.memory.buffer).copyWithin(to, from, from + Number(size)); return to; },
      memmove: (to, from, size) => { new Uint8Array(this.memory.buffer).copyWithin(to, from, from + Number(size)); return to; },
      count_add: () => 0, count_sub: () => 0,
      NRT_MemInfo_alloc_aligned: (size, align) => this.lent(Number(size), Number(align)),
      NRT_MemInfo_alloc: (size) => this.lent(Number(size), 64),
      NRT_MemInfo_alloc_safe_aligned: (size, align) => this.lent(Number(size), Number(align)),
      // the product of two 128-bit numbers, low half first: sizes of arrays are checked with it
      __multi3: (to, a, aHigh, b, bHigh) => {
        const wide = (low, high) => (BigInt.asUintN(64, high) << 64n) | BigInt.asUintN(64, low);
        const product = BigInt.asUintN(128, wide(a, aHigh) * wide(b, bHigh));
        const view = new DataView(this.memory.buffer);
        view.setBigUint64(to, product & 0xffffffffffffffffn, true);
        view.setBigUint64(to + 8, product >> 64n, true);
      },
      NRT_MemInfo_call_dtor: () => {},
      NRT_incref: () => {}, NRT_decref: () => {},
    };
    known.fmod = (a, b) => a % b; // the same remainder, to the last bit
    known.nearbyint = known.rint;
    known.roundeven = known.rint;
    return known[name] || (() => { throw new Error(`the kernel asked for ${name}, which the page does not have`); });
  }

  // What numba's allocator gives: a header with the place of the data at 16 or 24.
  lent(size, align) {
    const head = (this.scratch + 63) & ~63;
    const data = (head + 64 + Math.max(align, 64) - 1) & ~(Math.max(align, 64) - 1);
    this.scratch = data + size;
    this.grow(this.scratch);
    const view = new DataView(this.memory.buffer);
    view.setBigInt64(head, 1n, true);
    view.setUint32(head + 8, 0, true);
    view.setUint32(head + 12, 0, true);
    view.setUint32(head + 16, data, true);
    view.setUint32(head + 24, data, true); // where code that was optimised for pointers of 64 bits looks for it
    view.setBigInt64(head + 32, BigInt(size), true);
    return head;
  }

  grow(end) {
    const missing = end - this.memory.buffer.byteLength;
    if (missing > 0) this.memory.grow(Math.ceil(missing / 65536) + 16);
  }

  // Room that stays; what a call is lent lies behind it.
  room(bytes) {
    const at = (this.top + 63) & ~63;
    this.top = at + bytes + 64;
    this.grow(this.top);
    return at;
  }

  mark() {
    return this.top;
  }

  release(mark) {
    this.top = mark;
  }

  blob(k) {
    if (!this.blobs[k]) this.blobs[k] = typeof this.tables.blobs[k] === "string" ? bytesOf(this.tables.blobs[k]) : this.tables.blobs[k];
    return this.blobs[k];
  }

  put(bytes) {
    const at = this.room(bytes.length);
    new Uint8Array(this.memory.buffer).set(bytes, at);
    return at;
  }

  f64(at, length) {
    return new Float64Array(this.memory.buffer, at, length);
  }

  f32(at, length) {
    return new Float32Array(this.memory.buffer, at, length);
  }

  i64(at, length) {
    return new BigInt64Array(this.memory.buffer, at, length);
  }

  // Calls an export; `told` gives each argument by name: {at, shape} of an array, or a number.
  call(name, told) {
    if (!this.plans.has(name)) {
      const order = this.tables.orders[name].map((each) => each.split("#")).map(([argument, axis]) => [argument, axis === undefined ? -1 : Number(axis)]);
      this.plans.set(name, { order, entry: this.instance.exports[`entry_${name}`] });
    }
    const { order, entry } = this.plans.get(name);
    const values = new Array(order.length);
    for (let k = 0; k < order.length; k++) {
      const value = told[order[k][0]];
      if (value === undefined) throw new Error(`${name} needs ${order[k][0]}`);
      values[k] = order[k][1] >= 0 ? value.shape[order[k][1]] : typeof value === "number" ? value : value.at;
    }
    this.scratch = this.top;
    entry(...values);
  }
}

// A record in memory, its fields by name.
class Records {
  constructor(kernels, layout, count) {
    this.kernels = kernels;
    this.layout = layout;
    this.count = count;
    this.at = kernels.room(Math.max(layout.size * count, 8));
    new Uint8Array(kernels.memory.buffer).fill(0, this.at, this.at + layout.size * count);
  }

  get array() {
    return { at: this.at, shape: [this.count] };
  }

  set(name, value, k = 0) {
    const [offset, kind] = this.layout.fields[name];
    const place = this.at + k * this.layout.size + offset;
    const values = Array.isArray(value) ? value : [value];
    new KINDS[kind](this.kernels.memory.buffer, place, values.length).set(kind === "<i8" ? values.map(BigInt) : values);
  }

  get(name, k = 0) {
    const [offset, kind] = this.layout.fields[name];
    return Number(new KINDS[kind](this.kernels.memory.buffer, this.at + k * this.layout.size + offset, 1)[0]);
  }
}
