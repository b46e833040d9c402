// Reads what pictures/arm_glb.py writes: nodes that turn and slide, meshes of triangles, linear animations.
"use strict";

const multiplied = (a, b, out = new Float32Array(16)) => { // 4 x 4 matrices, column by column
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++)
    out[4 * c + r] = a[r] * b[4 * c] + a[r + 4] * b[4 * c + 1] + a[r + 8] * b[4 * c + 2] + a[r + 12] * b[4 * c + 3];
  return out;
};

const placed = ([x, y, z, w], [px, py, pz]) => new Float32Array([ // of a unit quaternion and a position
  1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0, 2 * (x * y - w * z), 1 - 2 * (x * x + z * z),
  2 * (y * z + w * x), 0, 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0, px, py, pz, 1]);

class Gltf {
  constructor(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset), length = view.getUint32(12, true);
    this.json = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + length)));
    this.data = bytes.slice(28 + length); // a copy, so that arrays are aligned
    this.nodes = this.json.nodes.map((node) => ({ name: node.name, mesh: node.mesh, parent: -1,
      turn: node.rotation || [0, 0, 0, 1], slide: node.translation || [0, 0, 0], children: node.children || [] }));
    this.nodes.forEach((node, k) => node.children.forEach((child) => { this.nodes[child].parent = k; }));
    this.order = [];
    const visit = (k) => { this.order.push(k); this.nodes[k].children.forEach(visit); };
    this.json.scenes[0].nodes.forEach(visit);
    this.animations = Object.fromEntries((this.json.animations || []).map((one) => [one.name, one.channels.map((channel) => {
      const sampler = one.samplers[channel.sampler];
      return { ...channel.target, times: this.array(sampler.input), values: this.array(sampler.output) };
    })]));
    this.meshes = this.json.meshes.map((mesh) => mesh.primitives.map((part) => ({
      positions: this.array(part.attributes.POSITION), normals: this.array(part.attributes.NORMAL),
      triangles: this.array(part.indices), box: this.json.accessors[part.attributes.POSITION],
      colour: this.json.materials[part.material].pbrMetallicRoughness.baseColorFactor.slice(0, 3) })));
  }

  array(index) {
    const accessor = this.json.accessors[index], view = this.json.bufferViews[accessor.bufferView];
    const kind = { 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array }[accessor.componentType];
    return new kind(this.data.buffer, view.byteOffset, accessor.count * { SCALAR: 1, VEC3: 3, VEC4: 4 }[accessor.type]);
  }

  // World matrices of all nodes at time t of an animation.
  pose(animation, t) {
    const turns = new Map(), slides = new Map();
    for (const channel of this.animations[animation])
      (channel.path === "rotation" ? turns : slides).set(channel.node, this.sample(channel, t));
    return this.placements(turns, slides);
  }

  // World matrices of all nodes, of which some are turned and slid in another way than in the file.
  placements(turns = new Map(), slides = new Map()) {
    const world = [];
    for (const k of this.order) {
      const node = this.nodes[k], own = placed(turns.get(k) || node.turn, slides.get(k) || node.slide);
      world[k] = node.parent < 0 ? own : multiplied(world[node.parent], own);
    }
    return world;
  }

  sample({ times, values, path }, t) {
    const size = path === "rotation" ? 4 : 3, last = times.length - 1;
    const after = Math.min(Math.max(below(times, t), 1), Math.max(last, 0)), before = Math.max(after - 1, 0);
    const gap = times[after] - times[before], s = gap > 0 ? Math.min(Math.max((t - times[before]) / gap, 0), 1) : 0;
    const a = values.subarray(size * before, size * before + size), b = values.subarray(size * after, size * after + size);
    let [from, to] = [1 - s, s];
    if (size === 4) { // along the great circle
      const angle = Math.acos(Math.min(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3], 1));
      if (angle > 1e-4) [from, to] = [Math.sin(from * angle) / Math.sin(angle), Math.sin(to * angle) / Math.sin(angle)];
    }
    return Array.from(a, (v, k) => from * v + to * b[k]);
  }

  // Where the corners of all meshes' boxes are at 61 times of an animation, (k, 3): the arm stays among them. y up.
  corners(animation, duration) {
    const found = [];
    for (let k = 0; k <= 60; k++) found.push(...this.boxes(this.pose(animation, duration * k / 60)));
    return found;
  }

  // Corners of all meshes' boxes where the nodes are in the world.
  boxes(world) {
    const found = [];
    this.nodes.forEach((node, n) => { if (node.mesh !== undefined) for (const { box } of this.meshes[node.mesh])
      for (let corner = 0; corner < 8; corner++) {
        const p = [0, 1, 2].map((i) => (corner >> i & 1 ? box.max : box.min)[i]), m = world[n];
        found.push([0, 1, 2].map((i) => m[i] * p[0] + m[i + 4] * p[1] + m[i + 8] * p[2] + m[i + 12]));
      } });
    return found;
  }
}
