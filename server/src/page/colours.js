// Colours of points: by range as the service's own pictures have them, by reflectance, by label, by fate.

const CLASS_NAMES = {{class_names}};
const CLASS_COLOURS = [
  [107, 114, 128], [100, 160, 255], [100, 230, 245], [100, 120, 230], [150, 110, 240], [120, 130, 255], [255, 100, 100],
  [255, 80, 200], [210, 90, 150], [125, 128, 158], [165, 143, 192], [190, 140, 170], [143, 122, 92], [227, 176, 75],
  [201, 134, 82], [79, 174, 98], [160, 112, 68], [159, 191, 106], [242, 227, 148], [255, 107, 94],
];
const FATE_NAMES = ["kept", "dropped", "no ray of its own", "added"];
const FATE_COLOURS = [[96, 190, 130], [224, 82, 76], [84, 92, 108], [120, 190, 255]];

/** Google's Turbo in its polynomial form (Anton Mikhailov, 2019), t from 0 to 1. */
function turbo(t) {
  const polynomial = (c) => Math.round(255 * Math.min(1, Math.max(0, c.reduceRight((sum, k) => sum * t + k, 0))));
  return [
    polynomial([0.135721, 4.615392, -42.66032, 132.13108, -152.9424, 59.28638]),
    polynomial([0.0914026, 2.194188, 4.842966, -14.185033, 4.277298, 2.829566]),
    polynomial([0.106673, 12.641946, -60.58205, 110.36277, -89.90311, 27.34825]),
  ];
}

/** Near is red, far is blue, by the logarithm from 2 m to 100 m. */
const RANGE_COLOURS = Array.from({ length: 256 }, (_, i) => turbo(0.08 + 0.8 * (1 - i / 255)));
const place_of_range = (range_m) => Math.min(1, Math.max(0, Math.log(range_m / 2) / Math.log(50)));

/** From dark to light by the square root, since most of the world is dark. */
const REFLECTANCE_STOPS = [[36, 44, 72], [58, 96, 152], [132, 184, 216], [255, 246, 226]];
const REFLECTANCE_COLOURS = Array.from({ length: 256 }, (_, i) => {
  const at = Math.sqrt(i / 255) * (REFLECTANCE_STOPS.length - 1);
  const below = Math.min(Math.floor(at), REFLECTANCE_STOPS.length - 2);
  return REFLECTANCE_STOPS[below].map((from, k) => from + (at - below) * (REFLECTANCE_STOPS[below + 1][k] - from));
});

const COLOUR_OF = {
  range: (cloud, i) => RANGE_COLOURS[Math.round(255 * place_of_range(cloud.range_m[i]))],
  reflectance: (cloud, i) => REFLECTANCE_COLOURS[Math.round(255 * Math.min(1, Math.max(0, cloud.reflectance[i])))],
  label: (cloud, i) => CLASS_COLOURS[cloud.label[i]] ?? CLASS_COLOURS[0],
  fate: (cloud, i) => FATE_COLOURS[cloud.fate[i]],
};

/** The colours of a cloud's points, four bytes each. */
function colours(cloud, by) {
  const bytes = new Uint8ClampedArray(4 * cloud.points).fill(255);
  for (let i = 0; i < cloud.points; i++) bytes.set(COLOUR_OF[by](cloud, i), 4 * i);
  return bytes;
}

/** Fills an element with the meaning of the colours of these clouds. */
function show_legend(element, by, clouds) {
  element.replaceChildren();
  if (by === "range" || by === "reflectance") {
    const [canvas, low, high] = [document.createElement("canvas"), document.createElement("span"), document.createElement("span")];
    [low.textContent, high.textContent] = by === "range" ? ["2 m", "100 m"] : ["0", "1"];
    [canvas.width, canvas.height] = [256, 1];
    const [context, palette] = [canvas.getContext("2d"), by === "range" ? RANGE_COLOURS : REFLECTANCE_COLOURS];
    for (let i = 0; i < 256; i++) {
      context.fillStyle = `rgb(${palette[i].join(" ")})`;
      context.fillRect(i, 0, 1, 1);
    }
    element.append(low, canvas, high);
    return;
  }
  const [names, palette, field] = by === "label" ? [CLASS_NAMES, CLASS_COLOURS, "label"] : [FATE_NAMES, FATE_COLOURS, "fate"];
  const there = new Set(clouds.flatMap((cloud) => [...new Set(cloud[field])]));
  for (const index of [...there].sort((a, b) => a - b)) {
    const [entry, dot] = [document.createElement("span"), document.createElement("i")];
    dot.style.background = `rgb(${palette[index].join(" ")})`;
    entry.append(dot, names[index]);
    element.append(entry);
  }
}
