// Where every link is at any time.

const times = new Float64Array(bytes(data.times).buffer);
const [start, end] = [times[0], times[times.length - 1]];

// Position and quaternion (7 numbers) of each link: frame after frame, or once where the link never moves.
const tracks = [];
for (let from = 0, poses = floats(data.poses); tracks.length < links.length; from += tracks.at(-1).length)
  tracks.push(poses.subarray(from, from + 7 * data.frames[tracks.length]));

// The last frame that is not later than t, and which share of the way to the next one is done.
function frameAt(t) {
  let low = 0, high = times.length;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle; else high = middle;
  }
  return high === times.length ? [low, 0] : [low, (t - times[low]) / (times[high] - times[low])];
}

const coming = new THREE.Object3D();

function moveLinks(t) {
  const [frame, share] = frameAt(t);
  links.forEach((link, i) => {
    const at = tracks[i].length > 7 ? 7 * frame : 0, track = tracks[i];
    place(link, track.subarray(at, at + 7));
    if (share > 0 && track.length > 7) {
      place(coming, track.subarray(at + 7, at + 14));
      link.position.lerp(coming.position, share);
      link.quaternion.slerp(coming.quaternion, share);
    }
  });
}

// Corners of the links' boxes all through the motion, at 200 instants of a long one and fewer of a large robot: what there is to see.
// In the world; and from the root link's origin, with how far that goes from where it starts.
function reach() {
  links.forEach(link => place(link, [0, 0, 0, 1, 0, 0, 0]));
  const boxes = links.map(link => new THREE.Box3().setFromObject(link)), points = [], fromRoot = [];
  const instants = Math.min(times.length, 200, Math.ceil(20000 / links.length));
  const root = links[0].position, first = new THREE.Vector3();
  let travel = 0;
  for (let n = 0; n < instants; n++) {
    moveLinks(times[Math.round(n * (times.length - 1) / Math.max(1, instants - 1))]);
    if (n === 0) first.copy(root);
    travel = Math.max(travel, root.distanceTo(first));
    links.forEach((link, i) => {
      if (boxes[i].isEmpty() || (n > 0 && tracks[i].length === 7)) return;
      link.updateMatrix();
      const { min, max } = boxes[i];
      for (const x of [min.x, max.x]) for (const y of [min.y, max.y]) for (const z of [min.z, max.z]) {
        const point = new THREE.Vector3(x, y, z).applyMatrix4(link.matrix);
        points.push(point);
        fromRoot.push(point.clone().sub(root));
      }
    });
  }
  return { points, fromRoot, travel };
}
