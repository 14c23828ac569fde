// meshcat's viewer with the robot in it: light, floor and camera, as large as the motion, or as the robot where that goes far.

const FRONT = new THREE.Vector3(1, -1.35, 0.7).normalize(); // from the robot to the camera; z is up
const FOV = 32; // [deg]

const largest = (items, size) => items.reduce((most, item) => Math.max(most, size(item)), 0);

function webglWorks() {
  const canvas = document.createElement("canvas");
  return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
}

function openStage() {
  const pane = byId("stage");
  const renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
  renderer.outputEncoding = THREE.sRGBEncoding;
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = THREE.PCFSoftShadowMap;
  pane.appendChild(renderer.domElement);

  const viewer = new MeshCat.Viewer(pane, true, renderer);
  viewer.set_property(["Background"], "visible", false); // the page's own shows through
  for (const name of ["Lights", "Grid", "Axes"]) viewer.delete_path([name]);
  viewer.set_object(["Robot"], new THREE.Group().add(...links));

  const { points, fromRoot, travel } = reach();
  const whole = extent(points);
  const floor = Math.min(0, whole.box.min.z);
  viewer.set_object(["Floor"], shadowFloor(whole.centre, whole.radius, floor));
  viewer.set_object(["Grid"], grid(whole.centre, whole.radius, floor));

  // The bar covers the lower edge: the middle of the picture is the middle of what stands above it.
  const bar = () => byId("controls").offsetHeight + 16;
  viewer.set_3d_pane_size = () => {
    const [width, height] = [pane.clientWidth || 1, pane.clientHeight || 1];
    viewer.camera.setViewOffset(width, height, 0, bar() / 2, width, height);
    MeshCat.Viewer.prototype.set_3d_pane_size.call(viewer, width, height);
  };

  // Either the whole motion is in the picture, or the robot is, and camera and light go with its root.
  const root = new THREE.Vector3(), button = byId("follow");
  let following, lamps;
  function setFollowing(on) {
    following = on;
    button.setAttribute("aria-pressed", on);
    root.copy(links[0].position);
  }
  function frame(on) {
    setFollowing(on);
    const { points, centre, radius } = on ? extent(fromRoot.map(point => point.clone().add(root))) : whole;
    lamps = lights(centre, radius, floor);
    viewer.set_object(["Lights"], lamps);
    viewer.set_3d_pane_size();
    lookAt(viewer, points, centre, radius, 1 - (bar() + 60) / Math.max(pane.clientHeight, 200), whole.radius);
  }
  function follow() {
    if (!following) return;
    const step = links[0].position.clone().sub(root);
    root.add(step);
    lamps.position.add(step);
    for (const place of [viewer.camera.position, viewer.controls.target]) place.add(new THREE.Vector3(step.x, step.z, -step.y));
  }
  byId("frame").addEventListener("click", () => frame(false));
  button.addEventListener("click", () => (following ? setFollowing(false) : frame(true)));

  // In a picture of the whole motion, a robot that goes further than this would be a speck.
  const far = travel > 4 * extent(fromRoot).radius;
  button.hidden = !far;
  moveLinks(start);
  frame(far);
  return { viewer, follow };
}

// The box around points, its centre, and how far they are from there.
function extent(points) {
  const box = new THREE.Box3().setFromPoints(points), centre = box.getCenter(new THREE.Vector3());
  return { points, box, centre, radius: largest(points, point => point.distanceTo(centre)) || 1 };
}

// Puts the camera as near as it sees all points, in the middle `share` of the picture's height; it sees `far` beyond them.
function lookAt(viewer, points, centre, radius, share, far) {
  const { camera, controls } = viewer;
  camera.fov = FOV;
  const height = Math.tan(FOV / 2 * Math.PI / 180), width = height * camera.aspect;
  const right = new THREE.Vector3(0, 0, 1).cross(FRONT).normalize(), up = FRONT.clone().cross(right);
  const distance = Math.max(2 * radius, largest(points, point => {
    const p = point.clone().sub(centre);
    return p.dot(FRONT) + Math.max(Math.abs(p.dot(right)) / (0.92 * width), Math.abs(p.dot(up)) / (share * height));
  }));

  // meshcat's camera lives in a frame whose y is up.
  const position = centre.clone().addScaledVector(FRONT, distance);
  camera.position.set(position.x, position.z, -position.y);
  controls.target.set(centre.x, centre.z, -centre.y);
  camera.near = radius / 100;
  camera.far = distance + 100 * far;
  controls.update();
  viewer.set_dirty();
}

function lights(centre, radius, floor) {
  const group = new THREE.Group();
  group.position.copy(centre);

  const key = new THREE.DirectionalLight(0xffffff, 0.68);
  key.position.set(0.35, -0.5, 1).multiplyScalar(4 * radius);
  key.target = group;
  key.castShadow = true;
  key.shadow.mapSize.set(2048, 2048);
  key.shadow.bias = -1e-4;
  key.shadow.normalBias = 0.004 * radius;
  const seen = 1.15 * Math.hypot(radius, 0.5 * (centre.z - floor));
  Object.assign(key.shadow.camera, { left: -seen, right: seen, top: seen, bottom: -seen, near: radius, far: 12 * radius });

  const rim = new THREE.DirectionalLight(0xffffff, 0.18);
  rim.position.set(-1, 0.6, 0.5).multiplyScalar(4 * radius);
  rim.target = group;

  const sky = new THREE.HemisphereLight(0xffffff, 0x8d929b, 0.44);
  sky.position.set(0, 0, 1);
  return group.add(key, rim, sky);
}

function shadowFloor(centre, radius, floor) {
  const plane = new THREE.Mesh(new THREE.CircleGeometry(20 * radius, 64), new THREE.ShadowMaterial({ opacity: 0.18, depthWrite: false }));
  plane.position.set(centre.x, centre.y, floor - 1e-3 * radius);
  plane.receiveShadow = true;
  return plane;
}

// Lines that fade with the distance from the robot; those through the world's origin in the colours of x and y.
function grid(centre, radius, floor) {
  const decade = 10 ** Math.floor(Math.log10(radius / 2));
  const cell = decade * [5, 2, 1].find(step => step * decade <= radius / 2);
  const count = Math.ceil(6 * radius / cell), origin = [Math.round(centre.x / cell), Math.round(centre.y / cell)];
  const positions = [], colours = [];
  for (const along of [0, 1]) {
    for (let line = -count; line <= count; line++) {
      const world = line + origin[1 - along];
      const colour = world !== 0 ? [0.45, 0.49, 0.55] : along === 0 ? [0.80, 0.15, 0.15] : [0.10, 0.55, 0.20];
      for (let step = -count; step < count; step++) {
        for (const at of [step, step + 1]) {
          const ends = [cell * (at + origin[along]), cell * world];
          positions.push(...(along === 0 ? ends : ends.reverse()), floor - 5e-4 * radius);
          colours.push(...colour, (world === 0 ? 0.9 : 0.5) * Math.max(0, 1 - Math.hypot(at, line) / count) ** 2);
        }
      }
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(positions, 3));
  geometry.setAttribute("color", new THREE.Float32BufferAttribute(colours, 4));
  return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false }));
}
