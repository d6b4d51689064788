// The motion: where every body is at any value of the parameter. Between two rows, joints turn and slide evenly.

class Motion {
  /** Bodies of a scene; ``array`` gives the arrays of references. */
  constructor(THREE, scene, array) {
    this.THREE = THREE;
    this.discrete = scene.parameter.discrete;
    this.rows = array(scene.rows);
    this.count = this.rows.length;
    this.first = this.rows[0];
    this.last = this.rows[this.count - 1];
    this.direction = this.last < this.first ? -1 : 1;
    this.nodes = scene.nodes.map((node) => ({ ...node, values: node.values ? array(node.values) : null }));
    this.modes = scene.modes;
    for (const node of this.nodes) node.whole = node.values;
    if (scene.modes) this.choose(0, 0.5);
    if (!THREE) return; // without graphics there are only rows
    for (const node of this.nodes) {
      node.origin = new THREE.Vector3(...node.place.slice(0, 3));
      node.turn = new THREE.Quaternion(...node.place.slice(3));
      node.along = new THREE.Vector3(...node.axis);
      node.matrix = new THREE.Matrix4();
    }
    this.unit = new THREE.Vector3(1, 1, 1);
  }

  /** Show a mode with a share of its amplitude: positions of its levels, one after the other, with evenly between. */
  choose(mode, share) {
    const { levels } = this.modes;
    const level = Math.min(Math.floor(share * (levels - 1)), levels - 2);
    const fraction = share * (levels - 1) - level;
    for (const node of this.nodes) {
      if (!node.whole) continue;
      const width = node.kind === "pose" ? 7 : 1;
      const size = this.count * width;
      const from = (mode * levels + level) * size;
      node.values = Float64Array.from({ length: size }, (_, k) =>
        node.whole[from + k] + fraction * (node.whole[from + size + k] - node.whole[from + k]));
      for (let k = 3; width === 7 && k < size; k += 7) {
        const length = Math.hypot(...node.values.subarray(k, k + 4));
        for (let part = k; part < k + 4; part += 1) node.values[part] /= length;
      }
    }
  }

  /** Return [row, fraction of the way to the next]; at a jump, where two rows share a value, the later one. */
  locate(value) {
    const wanted = this.direction * value;
    let low = 0;
    let high = this.count;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.direction * this.rows[middle] <= wanted) low = middle;
      else high = middle;
    }
    if (low === this.count - 1 || this.discrete) return [low, 0];
    return [low, Math.max(0, (value - this.rows[low]) / (this.rows[low + 1] - this.rows[low]))];
  }

  /** Return the numbers of an array with ``width`` a row, at a place found by ``locate``. */
  blend(array, width, [row, fraction]) {
    const numbers = [];
    for (let k = row * width; k < (row + 1) * width; k += 1) {
      numbers.push(fraction ? array[k] + fraction * (array[k + width] - array[k]) : array[k]);
    }
    return numbers;
  }

  /** Compute the placement in the world of every body. */
  place(value) {
    const { Vector3, Quaternion } = this.THREE;
    const at = this.locate(value);
    for (const node of this.nodes) {
      const position = node.origin.clone();
      const turn = node.turn.clone();
      if (node.kind === "turn") {
        turn.multiply(new Quaternion().setFromAxisAngle(node.along, this.blend(node.values, 1, at)[0]));
      } else if (node.kind === "slide") {
        position.addScaledVector(node.along.clone().applyQuaternion(turn), this.blend(node.values, 1, at)[0]);
      } else if (node.kind === "pose") {
        position.add(new Vector3(...this.blend(node.values, 7, at).slice(0, 3)).applyQuaternion(turn));
        turn.multiply(this.slerp(node.values, at));
      }
      node.matrix.compose(position, turn, this.unit);
      if (node.parent >= 0) node.matrix.premultiply(this.nodes[node.parent].matrix);
    }
    return at;
  }

  slerp(values, [row, fraction]) {
    const { Quaternion } = this.THREE;
    const from = new Quaternion(...values.subarray(7 * row + 3, 7 * row + 7));
    return fraction ? from.slerp(new Quaternion(...values.subarray(7 * row + 10, 7 * row + 14)), fraction) : from;
  }

  /** Return a point of a body in the world. */
  point(node, local) {
    return new this.THREE.Vector3(...local).applyMatrix4(this.nodes[node].matrix);
  }
}
