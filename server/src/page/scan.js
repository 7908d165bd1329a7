// A scan before and after, from the records of `application/vnd.realbeam.points`.

const RECORD = 10;
const [KEPT, DROPPED, UNSEEN, ADDED] = [0, 1, 2, 3];

/** Both clouds of an answer; `mirrored` where the sender's y points to the right. */
function read_records(buffer, mirrored) {
  const records = new Float32Array(buffer);
  const before = empty_cloud(records.length / RECORD);
  const after = empty_cloud(records.length / RECORD);
  for (let at = 0; at < records.length; at += RECORD) {
    const [x, y, z, reflectance, range_after_m, reflectance_after, ring, column, label, fate] = records.subarray(at, at + RECORD);
    const range_m = Math.hypot(x, y, z);
    if (!Number.isFinite(range_m) || range_m === 0) continue;
    const place = [x, mirrored ? -y : y, z];
    const rest = { ring, column, label, fate };
    if (fate !== ADDED) add(before, { place, range_m, reflectance, ...rest });
    if (fate === KEPT || fate === ADDED) {
      const moved = place.map((metres) => (metres * range_after_m) / range_m);
      add(after, { place: moved, range_m: range_after_m, reflectance: reflectance_after, ...rest });
    }
  }
  return { before: cut(before), after: cut(after) };
}

function empty_cloud(most) {
  const floats = (n) => new Float32Array(n);
  return {
    points: 0, place: floats(3 * most), range_m: floats(most), reflectance: floats(most), ring: new Int16Array(most),
    column: new Int16Array(most), label: new Uint8Array(most), fate: new Uint8Array(most),
  };
}

function add(cloud, { place, ...point }) {
  cloud.place.set(place, 3 * cloud.points);
  for (const [field, value] of Object.entries(point)) cloud[field][cloud.points] = value;
  cloud.points++;
}

function cut(cloud) {
  const cut_to = ([field, values]) => [field, field === "points" ? values : values.subarray(0, values.length / cloud.fate.length * cloud.points)];
  return Object.fromEntries(Object.entries(cloud).map(cut_to));
}

/** Draws a range image: every point that has one in its pixel. */
function draw_image(canvas, cloud, bytes, rings, columns) {
  [canvas.width, canvas.height] = [columns, rings];
  const context = canvas.getContext("2d");
  const image = context.createImageData(columns, rings);
  for (let i = 0; i < cloud.points; i++) {
    if (cloud.column[i] < 0) continue;
    image.data.set(bytes.subarray(4 * i, 4 * i + 4), 4 * (cloud.ring[i] * columns + cloud.column[i]));
  }
  context.putImageData(image, 0, 0);
}
