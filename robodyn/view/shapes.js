// From the page's data to three.js: numbers, meshes, links.

const { THREE } = MeshCat;
const byId = id => document.getElementById(id);
const data = JSON.parse(byId("data").textContent);

function bytes(base64) {
  const text = atob(base64), array = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) array[i] = text.charCodeAt(i);
  return array;
}

const floats = base64 => new Float32Array(bytes(base64).buffer);

const GREY = [0.80, 0.82, 0.85, 1]; // of a visual without a colour
const CREASE = Math.cos(35 * Math.PI / 180); // faces that meet at a smaller angle are shaded as one curved surface

function materialOf([red, green, blue, alpha], options = {}) {
  const color = new THREE.Color(red, green, blue).convertSRGBToLinear();
  const glass = { transparent: alpha < 1, opacity: alpha, depthWrite: alpha === 1 };
  return new THREE.MeshStandardMaterial({ color, ...glass, roughness: 0.55, metalness: 0.05, ...options });
}

// Triangles that share no vertex, each corner with its own normal: the mean over the faces around that vertex
// that make no crease with the corner's own face.
function trianglesOf(part) {
  const vertices = floats(part.vertices), corners = new Uint32Array(bytes(part.triangles).buffer);
  const count = corners.length, positions = new Float32Array(3 * count), normals = new Float32Array(3 * count);
  corners.forEach((vertex, i) => positions.set(vertices.subarray(3 * vertex, 3 * vertex + 3), 3 * i));

  // Each face's normal: as long as twice its area, and of unit length.
  const wide = new Float32Array(count), unit = new Float32Array(count);
  const [a, b, c] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
  for (let i = 0; i < count; i += 3) {
    [a, b, c].forEach((corner, k) => corner.fromArray(positions, 3 * (i + k)));
    b.sub(a).cross(c.sub(a)).toArray(wide, i);
    b.normalize().toArray(unit, i);
  }

  // The faces around vertex v: faces[first[v]] to faces[first[v + 1] - 1].
  const first = new Uint32Array(vertices.length / 3 + 1), faces = new Uint32Array(count);
  for (const vertex of corners) first[vertex + 1]++;
  for (let v = 1; v < first.length; v++) first[v] += first[v - 1];
  const next = first.slice();
  corners.forEach((vertex, i) => { faces[next[vertex]++] = i - i % 3; });

  corners.forEach((vertex, i) => {
    const own = i - i % 3;
    a.set(0, 0, 0);
    for (let k = first[vertex]; k < first[vertex + 1]; k++) {
      const f = faces[k];
      if (unit[f] * unit[own] + unit[f + 1] * unit[own + 1] + unit[f + 2] * unit[own + 2] >= CREASE) {
        a.x += wide[f]; a.y += wide[f + 1]; a.z += wide[f + 2];
      }
    }
    a.normalize().toArray(normals, 3 * i);
  });

  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  if (part.colours) geometry.setAttribute("color", new THREE.BufferAttribute(cornerColours(bytes(part.colours)), 3));
  return geometry;
}

function cornerColours(ofFaces) {
  const colours = new Float32Array(3 * ofFaces.length), colour = new THREE.Color();
  for (let f = 0; f < ofFaces.length; f += 3) {
    colour.fromArray(ofFaces, f).multiplyScalar(1 / 255).convertSRGBToLinear();
    for (const corner of [0, 3, 6]) colour.toArray(colours, 3 * f + corner);
  }
  return colours;
}

const meshes = data.meshes.map(parts => parts.map(part => ({ ...part, geometry: trianglesOf(part) })));

const FORMS = {
  box: ([x, y, z]) => new THREE.BoxGeometry(x, y, z),
  cylinder: ([radius, length]) => new THREE.CylinderGeometry(radius, radius, length, 64).rotateX(Math.PI / 2), // from three's axis y to z
  sphere: ([radius]) => new THREE.SphereGeometry(radius, 64, 32),
};

function bodiesOf(shape) {
  if (shape.form !== "mesh") return [new THREE.Mesh(FORMS[shape.form](shape.size), materialOf(shape.colour || GREY))];
  return meshes[shape.mesh].map(part => {
    const painted = !shape.colour && part.colours !== undefined; // the robot's file decides before the mesh's own
    const colour = shape.colour || (painted ? [1, 1, 1, 1] : part.colour || GREY);
    const body = new THREE.Mesh(part.geometry, materialOf(colour, { vertexColors: painted, side: THREE.DoubleSide }));
    body.scale.fromArray(shape.size);
    return body;
  });
}

function place(object, [x, y, z, qw, qx, qy, qz]) {
  object.position.set(x, y, z);
  object.quaternion.set(qx, qy, qz, qw);
}

function linkOf(name, shapes) {
  const link = new THREE.Group();
  link.name = name;
  for (const shape of shapes) {
    for (const body of bodiesOf(shape)) {
      place(body, shape.place);
      body.castShadow = body.receiveShadow = true;
      link.add(body);
    }
  }
  return link;
}

const links = data.links.map((name, i) => linkOf(name, data.shapes[i]));
