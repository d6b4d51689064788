// The picture: meshcat's viewer with our light, ground and camera. What moves is in ``world``, whose axes are the model's.

class View {
  constructor(MeshCat, scene, array, motion) {
    const THREE = MeshCat.THREE;
    Object.assign(this, { THREE, motion, box: scene.view, detail: scene.view.detail, element: document.getElementById("view") });
    const renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: true });
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    this.element.prepend(renderer.domElement);
    this.viewer = new MeshCat.Viewer(renderer.domElement, false, renderer);
    this.viewer.set_3d_pane_size = () => {}; // it would take the whole window
    this.viewer.gui.domElement.remove();
    for (const path of ["Lights", "Grid", "Axes"]) this.viewer.delete_path([path]);
    this.viewer.hide_background();
    this.world = new THREE.Group();
    this.up = new THREE.Vector3(...scene.view.up);
    this.world.quaternion.setFromUnitVectors(this.up, new THREE.Vector3(0, 0, 1));
    this.viewer.scene.add(this.world);
    this.viewer.scene.updateMatrixWorld(true);
    this.bodies = motion.nodes.map(() => {
      const body = new THREE.Group();
      body.matrixAutoUpdate = false;
      this.world.add(body);
      return body;
    });
    for (const { node, solid } of solids(THREE, scene, array)) this.bodies[node].add(solid);
    this.low = new THREE.Vector3(...scene.view.low);
    this.high = new THREE.Vector3(...scene.view.high);
    this.centre = this.low.clone().add(this.high).multiplyScalar(0.5);
    this.size = this.low.distanceTo(this.high) || 1;
    this.light();
    this.ground();
    this.viewer.camera.fov = 28;
    this.moved = false;
    this.viewer.controls.addEventListener("start", () => { this.moved = true; });
  }

  light() {
    const { THREE, size } = this;
    this.world.add(new THREE.HemisphereLight(0xffffff, 0xcfd6dd, 0.64));
    const key = new THREE.DirectionalLight(0xffffff, 0.38);
    const [eye, up] = [new THREE.Vector3(...this.box.eye), this.up];
    const side = up.clone().cross(eye);
    key.position.copy(this.centre).addScaledVector(up, 1.6 * size).addScaledVector(eye, 0.9 * size)
      .addScaledVector(side, -0.7 * size);
    key.target.position.copy(this.centre);
    key.castShadow = true;
    key.shadow.mapSize.set(2048, 2048);
    key.shadow.radius = 4;
    key.shadow.normalBias = 0.004 * size;
    Object.assign(key.shadow.camera, { left: -size, right: size, top: size, bottom: -size, near: 0.1 * size, far: 5 * size });
    const fill = new THREE.DirectionalLight(0xffffff, 0.13);
    fill.position.copy(this.centre).addScaledVector(eye, size).addScaledVector(side, size);
    fill.target.position.copy(this.centre);
    this.world.add(key, key.target, fill, fill.target);
  }

  /** Lay a grid below the lowest point, and say how wide its squares are. */
  ground() {
    const { THREE, size, up } = this;
    this.cell = round(size / 12);
    const half = Math.ceil((1.1 * size) / this.cell) * this.cell;
    const level = Math.min(...this.box.outline.map((point) => new THREE.Vector3(...point).dot(up))) - 0.002 * size;
    const floor = new THREE.Group();
    const grid = new THREE.GridHelper(2 * half, Math.round((2 * half) / this.cell), 0xaab4be, 0xc9d1d9);
    Object.assign(grid.material, { transparent: true, opacity: 0.55, depthWrite: false });
    const shade = new THREE.Mesh(new THREE.PlaneGeometry(2 * half, 2 * half).rotateX(-Math.PI / 2),
      new THREE.ShadowMaterial({ opacity: 0.13, depthWrite: false }));
    shade.receiveShadow = true;
    floor.add(grid, shade);
    floor.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), up);
    const centre = this.centre.clone().addScaledVector(up, level - this.centre.dot(up));
    floor.position.copy(centre);
    const axes = new THREE.AxesHelper(0.09 * size);
    this.world.add(floor, axes);
  }

  /** Look at the whole motion from as near as it fits. */
  fit() {
    const { THREE } = this;
    const { camera, controls } = this.viewer;
    const eye = new THREE.Vector3(...this.box.eye).transformDirection(this.world.matrixWorld);
    const right = new THREE.Vector3(0, 1, 0).cross(eye).normalize();
    const above = eye.clone().cross(right);
    const points = this.box.outline.map((point) => new THREE.Vector3(...point).applyMatrix4(this.world.matrixWorld));
    const centre = this.centre.clone().applyMatrix4(this.world.matrixWorld);
    for (const axis of [right, above]) {
      const along = points.map((point) => point.dot(axis));
      centre.addScaledVector(axis, (Math.min(...along) + Math.max(...along)) / 2 - centre.dot(axis));
    }
    const high = Math.tan((camera.fov * Math.PI) / 360);
    const wide = high * camera.aspect;
    let distance = 0;
    for (const point of points) {
      const offset = point.sub(centre);
      const needed = Math.max(Math.abs(offset.dot(right)) / wide, Math.abs(offset.dot(above)) / high);
      distance = Math.max(distance, needed + offset.dot(eye));
    }
    distance = 1.18 * distance || 1;
    camera.near = distance / 100;
    camera.far = 100 * distance;
    camera.position.copy(centre).addScaledVector(eye, distance);
    controls.target.copy(centre);
    controls.update();
    this.moved = false;
  }

  resize() {
    const { clientWidth, clientHeight } = this.element;
    if (!clientWidth || !clientHeight) return;
    this.viewer.renderer.setSize(clientWidth, clientHeight);
    this.viewer.camera.aspect = clientWidth / clientHeight;
    this.viewer.camera.updateProjectionMatrix();
    if (!this.moved) this.fit();
  }

  /** Draw the bodies where the motion has placed them. */
  draw() {
    this.bodies.forEach((body, k) => {
      body.matrix.copy(this.motion.nodes[k].matrix);
      body.matrixWorldNeedsUpdate = true;
    });
    this.viewer.render();
    this.compass();
  }

  /** Show in the corner how the world's axes lie. */
  compass() {
    const { THREE } = this;
    const back = this.viewer.camera.getWorldQuaternion(new THREE.Quaternion()).invert();
    const names = [["x", "#d6453d", [1, 0, 0]], ["y", "#3a9d4a", [0, 1, 0]], ["z", "#3569c9", [0, 0, 1]]];
    const ends = names.map(([name, colour, axis]) => {
      const end = new THREE.Vector3(...axis).transformDirection(this.world.matrixWorld).applyQuaternion(back);
      return { name, colour, end };
    });
    ends.sort((a, b) => a.end.z - b.end.z);
    document.getElementById("compass").innerHTML = ends.map(({ name, colour, end }) => {
      const [x, y] = [end.x.toFixed(3), (-end.y).toFixed(3)];
      return `<line x1="0" y1="0" x2="${28 * x}" y2="${28 * y}" stroke="${colour}"/>`
        + `<text x="${40 * x}" y="${40 * y}">${name}</text>`;
    }).join("");
  }
}
