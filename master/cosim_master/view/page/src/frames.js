// From the recording's frames to the scene's: NED and FRD to x east, y up, z south, which three.js draws.

export const x = (ned, i = 0) => ned[i + 1];
export const y = (ned, i = 0) => -ned[i + 2];
export const z = (ned, i = 0) => -ned[i];

/** A point of the scene in NED. */
export const toNed = (v) => [-v.z, v.x, -v.y];

/** A quaternion w, x, y, z (FRD into NED) for the scene; the same turn of axes on both of its sides. */
export const rotation = (w, qx, qy, qz, out) => out.set(qy, -qz, -qx, w);
