// Meshes of vehicles, from where their FMUs say that the rotors are; a dart for those that say nothing.
import { BoxGeometry, BufferAttribute, BufferGeometry, CircleGeometry, ConeGeometry, CylinderGeometry, Matrix4, Quaternion, SphereGeometry, Vector3 } from 'three';

const FULL = [1, 1, 1]; // takes the vehicle's colour
const DARK = [0.36, 0.39, 0.44];
const PALE = [0.9, 0.93, 0.96];
const SOFT = [0.55, 0.58, 0.62]; // of discs that are parts of a body

/**
 * Geometries of one airframe: body (with colours per vertex), one rotor's blades and disc, hubs and reach in m.
 * `coarse` ones have few triangles; in `plain` ones the discs are parts of the body, so that there is one mesh only.
 */
export function airframe(rotors, coarse, plain) {
  return rotors && rotors.length ? multirotor(rotors, coarse, plain) : { ...dart(coarse), hubs: [], reach: 0.35 };
}

function multirotor(rotors, coarse, plain) {
  const hubs = rotors.map(([forward, right, down, direction]) => ({ place: new Vector3(right, -down, -forward), direction }));
  const apart = Math.min(...hubs.flatMap((a, i) => hubs.slice(i + 1).map((b) => a.place.distanceTo(b.place))), 0.6);
  const arm = Math.max(...hubs.map((hub) => Math.hypot(hub.place.x, hub.place.z)), 0.05);
  const disc = Math.min(0.46 * apart, 0.75 * arm) || 0.15;
  const sides = coarse ? 5 : 14;
  const parts = [];
  const hull = coarse ? new BoxGeometry(0.5 * arm, 0.24 * arm, 0.8 * arm) : new SphereGeometry(0.38 * arm, 22, 12).applyMatrix4(new Matrix4().makeScale(0.92, 0.42, 1.4));
  parts.push([hull, FULL]);
  if (!coarse) {
    parts.push([new SphereGeometry(0.2 * arm, 14, 8).applyMatrix4(new Matrix4().makeScale(0.8, 0.5, 0.8).setPosition(0, 0.14 * arm, 0.12 * arm)), DARK]);
    parts.push([new SphereGeometry(0.11 * arm, 12, 8).applyMatrix4(new Matrix4().setPosition(0, -0.1 * arm, -0.5 * arm)), DARK]);
    for (const side of [-1, 1]) {
      parts.push([tube(new Vector3(side * 0.2 * arm, -0.08 * arm, 0), new Vector3(side * 0.42 * arm, -0.42 * arm, 0), 0.03 * arm, 6), DARK]);
      parts.push([tube(new Vector3(side * 0.42 * arm, -0.42 * arm, -0.42 * arm), new Vector3(side * 0.42 * arm, -0.42 * arm, 0.42 * arm), 0.035 * arm, 6), DARK]);
    }
  }
  for (const { place } of hubs) {
    const front = place.z < -0.05 * arm;
    parts.push([tube(new Vector3(0, 0, 0), place, 0.055 * arm, coarse ? 4 : 8), front ? PALE : DARK]);
    if (!coarse) parts.push([new CylinderGeometry(0.1 * arm, 0.12 * arm, 0.16 * arm, sides).applyMatrix4(new Matrix4().setPosition(place.x, place.y, place.z)), DARK]);
  }
  const nose = new ConeGeometry(0.13 * arm, 0.34 * arm, coarse ? 4 : 12).applyMatrix4(new Matrix4().makeRotationX(-Math.PI / 2).setPosition(0, 0, -0.68 * arm));
  parts.push([nose, PALE]);
  const blade = (turn) => new BoxGeometry(1.9 * disc, 0.02 * arm, 0.13 * disc).applyMatrix4(new Matrix4().makeRotationX(0.16).premultiply(new Matrix4().makeRotationY(turn)));
  if (plain) {
    for (const { place } of hubs) {
      const above = new CircleGeometry(disc, 8).applyMatrix4(new Matrix4().makeRotationX(-Math.PI / 2).setPosition(place.x, place.y + 0.12 * arm, place.z));
      const below = new CircleGeometry(disc, 8).applyMatrix4(new Matrix4().makeRotationX(Math.PI / 2).setPosition(place.x, place.y + 0.11 * arm, place.z));
      parts.push([above, SOFT], [below, SOFT]);
    }
    return { body: merged(parts), blades: null, disc: null, hubs: [], reach: arm + disc };
  }
  return {
    body: merged(parts),
    blades: merged([[blade(0), FULL]]),
    disc: new CircleGeometry(disc, coarse ? 10 : 28).applyMatrix4(new Matrix4().makeRotationX(-Math.PI / 2)),
    hubs: hubs.map(({ place, direction }) => ({ place: place.clone().add(new Vector3(0, 0.12 * arm, 0)), direction })),
    reach: arm + disc,
  };
}

/** A dart that points forward: it shows attitude and heading of whatever it is. */
function dart(coarse) {
  const sides = coarse ? 4 : 16;
  const nose = new ConeGeometry(0.16, 0.6, sides).applyMatrix4(new Matrix4().makeRotationX(-Math.PI / 2).setPosition(0, 0, -0.05));
  const tail = new SphereGeometry(0.16, sides, coarse ? 4 : 10).applyMatrix4(new Matrix4().makeScale(1, 1, 0.7).setPosition(0, 0, 0.25));
  const fin = new BoxGeometry(0.025, 0.24, 0.2).applyMatrix4(new Matrix4().setPosition(0, 0.14, 0.26));
  return { body: merged([[nose, FULL], [tail, FULL], [fin, PALE]]), blades: null, disc: null };
}

function tube(from, to, radius, sides) {
  const along = new Vector3().subVectors(to, from);
  const turn = new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), along.clone().normalize());
  const middle = new Vector3().addVectors(from, to).multiplyScalar(0.5);
  return new CylinderGeometry(radius, radius, along.length(), sides).applyMatrix4(new Matrix4().compose(middle, turn, new Vector3(1, 1, 1)));
}

/** One geometry of several, each with a colour. */
function merged(parts) {
  const flat = parts.map(([geometry, colour]) => [geometry.toNonIndexed(), colour]);
  const count = flat.reduce((sum, [geometry]) => sum + geometry.attributes.position.count, 0);
  const [position, normal, colours] = [0, 1, 2].map(() => new Float32Array(count * 3));
  let at = 0;
  for (const [geometry, colour] of flat) {
    position.set(geometry.attributes.position.array, at);
    normal.set(geometry.attributes.normal.array, at);
    for (let i = 0; i < geometry.attributes.position.count; i++) colours.set(colour, at + 3 * i);
    at += geometry.attributes.position.array.length;
  }
  const whole = new BufferGeometry();
  whole.setAttribute('position', new BufferAttribute(position, 3));
  whole.setAttribute('normal', new BufferAttribute(normal, 3));
  whole.setAttribute('color', new BufferAttribute(colours, 3));
  return whole;
}
