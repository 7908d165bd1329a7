// The page: what is chosen goes to POST /v1/scan, and what comes back is shown.

const element = (id) => document.getElementById(id);
const number = new Intl.NumberFormat("en");
const POINTS = "application/vnd.realbeam.points";

/** What GET /info says; the scan that is shown, as { bytes, name, is_sample }; and its answer. */
let [info, scan, answer] = [undefined, undefined, undefined];
let asking = new AbortController();
const view = create_view(element("view"));

const model = () => info.models.find((one) => one.name === element("model").value);
const media_type = (name) => info.media_types.find((one) => one.name === name);
const colouring = () => document.querySelector("input[name=colour]:checked").value;

function option(value, text) {
  const made = document.createElement("option");
  [made.value, made.textContent] = [value, text];
  return made;
}

function say(text, kind = "") {
  [element("status").textContent, element("status").className] = [text, kind];
}

/** The token of a service that asks for one; known to this page as long as it is open, and to nothing else. */
let token = "";

/** Waits until the person has given a token. */
function token_from_person() {
  document.body.dataset.token = "asked";
  element("token").focus();
  return new Promise((given) => element("unlock").addEventListener("click", given, { once: true }));
}

function unlock() {
  token = element("token").value.trim();
  element("token").value = "";
  document.body.dataset.token = "given";
  say("");
}

/** Fetches, with the token if the service asks for it; an answer that is none becomes an error in the service's own words. */
async function ask(path, options) {
  const tried = token;
  const headers = tried ? { ...options?.headers, authorization: `Bearer ${tried}` } : options?.headers;
  const response = await fetch(path, { ...options, headers });
  if (response.ok) return response;
  if (response.status === 401) {
    if (token === tried) {
      say(tried ? "That is not this service's token." : "This service asks for its token.", tried ? "bad" : "");
      await token_from_person();
    }
    return ask(path, options);
  }
  const body = await response.json().catch(() => ({}));
  throw new Error(body.error ?? `the service answered ${response.status}`);
}

/** Runs something that a person has to wait for, and says so where it fails. */
async function busily(text, work) {
  asking.abort();
  const mine = (asking = new AbortController());
  document.body.dataset.busy = "";
  say(text);
  try {
    await work(mine.signal);
  } catch (error) {
    if (!mine.signal.aborted) {
      say(error.message, "bad");
      if (document.body.dataset.state !== "empty") document.body.dataset.state = "failed";
    }
  } finally {
    if (asking === mine) delete document.body.dataset.busy;
  }
}

/** The request that makes the scan realistic, in a type of one's choice. */
function request(accept, signal) {
  const query = new URLSearchParams({ model: element("model").value, seed: element("seed").value.trim() });
  const headers = { "content-type": element("type").value, accept };
  return ask(`/v1/scan?${query}`, { method: "POST", headers, body: scan.bytes, signal });
}

function run() {
  if (!scan) return undefined;
  return busily("Asking the sensor…", async (signal) => {
    if (scan.is_sample && scan.of !== element("model").value) await take_sample(signal);
    const started = performance.now();
    const response = await request(POINTS, signal);
    const buffer = await response.arrayBuffer();
    const round_trip_ms = performance.now() - started;
    const mirrored = media_type(element("type").value).frame === "carla";
    answer = { ...read_records(buffer, mirrored), headers: response.headers, round_trip_ms };
    document.body.dataset.state = "shown";
    show();
  });
}

function show() {
  const warning = answer.headers.get("x-realbeam-warning");
  say(warning ?? "", "warn");
  element("caption-after").textContent = `As ${model().card.sensor.name} reports it`;
  view?.show(answer.before, answer.after);
  if (!view) say("This browser has no WebGL 2, so the cloud is not drawn; the range images are.", "warn");
  paint();
  show_counts();
  show_times();
  const own = [...answer.headers].filter(([name]) => /^(x-|server-timing|content-)/.test(name));
  element("headers").replaceChildren(...own.flatMap(([name, value]) => pair(name, value)));
}

function paint() {
  const by = colouring();
  const [before, after] = [colours(answer.before, by), colours(answer.after, by)];
  view?.paint(before, after);
  const { elevation_deg, columns } = model().card.sensor;
  draw_image(element("image-before"), answer.before, before, elevation_deg.length, columns);
  draw_image(element("image-after"), answer.after, after, elevation_deg.length, columns);
  show_legend(element("legend"), by, [answer.before, answer.after]);
}

function pair(name, value, colour) {
  const [term, said] = [document.createElement("dt"), document.createElement("dd")];
  [term.textContent, said.textContent] = [name, value];
  if (colour) {
    const dot = document.createElement("i");
    dot.style.background = colour;
    term.prepend(dot);
  }
  return [term, said];
}

function show_counts() {
  const count = (name) => Number(answer.headers.get(`x-realbeam-points-${name}`));
  const all = count("in");
  const rows = [["In", "in"], ["Kept", "kept"], ["Dropped", "dropped"], ["Behind a nearer one", "lost"], ["Out of range", "out-of-range"], ["Invalid", "invalid"], ["Added", "added"]];
  const shown = rows.filter(([, name]) => count(name) > 0 || name === "kept" || name === "dropped");
  element("counts").replaceChildren(...shown.flatMap(([text, name]) => {
    const row = pair(text, number.format(count(name)));
    const share = document.createElement("small");
    share.textContent = name === "in" || all === 0 ? "" : `${((100 * count(name)) / all).toFixed(1)} %`;
    row[1].append(share);
    return row;
  }));
}

function show_times() {
  const palette = ["#4b5566", "#6c7f9c", "#7fa3c7", "#9cc3dd", "#8fd0ff", "#b9a6e8", "#d9a0c5", "#e8b98a"];
  const stages = (answer.headers.get("server-timing") ?? "").split(", ").map((stage, i) => {
    const [name, ms] = stage.split(";dur=");
    return { name, ms: Number(ms), colour: palette[i % palette.length] };
  });
  const total_ms = stages.reduce((sum, stage) => sum + stage.ms, 0);
  element("bar").replaceChildren(...stages.map((stage) => {
    const part = document.createElement("span");
    [part.style.flexGrow, part.style.background, part.title] = [stage.ms, stage.colour, `${stage.name}: ${stage.ms} ms`];
    return part;
  }));
  const rows = stages.flatMap((stage) => pair(stage.name, `${stage.ms.toFixed(1)} ms`, stage.colour));
  const sums = [...pair("in the service", `${total_ms.toFixed(1)} ms`), ...pair("there and back", `${answer.round_trip_ms.toFixed(0)} ms`)];
  element("times").replaceChildren(...sums, ...rows);
}

/** Takes over a scan; its type is guessed by its name's ending, the longest that fits. */
function take(bytes, name) {
  const ending = ({ extension }) => name.toLowerCase().endsWith(`.${extension}`);
  const fitting = info.media_types.filter(ending).sort((a, b) => b.extension.length - a.extension.length);
  if (fitting.length === 0) throw new Error(`${name}: its ending tells no format; there are ${[...new Set(info.media_types.map((one) => one.extension))].join(", ")}`);
  element("type").value = fitting[0].name;
  scan = { bytes, name };
  element("source").textContent = `${name}, ${number.format(Math.ceil(bytes.byteLength / 1024))} KiB`;
}

async function take_sample(signal) {
  const of = element("model").value;
  const response = await ask(`/sample?${new URLSearchParams({ model: of })}`, { signal });
  take(await response.arrayBuffer(), "sample street.ply");
  Object.assign(scan, { is_sample: true, of });
}

async function use_sample() {
  await busily("Ray casting a street…", take_sample);
  await run();
}

async function use_file(file) {
  if (!file) return;
  let taken = false;
  await busily(`Reading ${file.name}…`, async () => {
    take(await file.arrayBuffer(), file.name);
    taken = true;
  });
  if (taken) await run();
}

function download() {
  const type = element("format").value;
  return busily("Asking for the file…", async (signal) => {
    const response = await request(type, signal);
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await response.blob());
    const ending = media_type(type)?.extension ?? "png";
    link.download = `${scan.name.replace(/\..*$/, "")} ${element("model").value} ${element("seed").value.trim()}.${ending}`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
    say(`Saved as ${link.download}`);
  });
}

function show_model() {
  const { sensor, summary } = model().card;
  element("about").textContent = `${summary}. ${sensor.elevation_deg.length} rings × ${sensor.columns} columns`;
}

/** Divides the view at a share of its width. */
function divide(share) {
  const held = Math.min(1, Math.max(0, share));
  element("divider").style.left = `${100 * held}%`;
  element("divider").setAttribute("aria-valuenow", Math.round(100 * held));
  view?.split_at(held);
}

function listen() {
  const on = (id, event, act) => element(id).addEventListener(event, act);
  for (const id of ["sample", "sample-again"]) on(id, "click", use_sample);
  for (const id of ["choose", "choose-again"]) on(id, "click", () => element("file").click());
  on("file", "change", () => {
    use_file(element("file").files[0]);
    element("file").value = "";
  });
  on("model", "change", () => { show_model(); run(); });
  on("type", "change", run);
  on("seed", "change", () => element("seed").validity.valid && run());
  on("reseed", "click", () => {
    element("seed").value = crypto.getRandomValues(new Uint32Array(1))[0];
    run();
  });
  on("colouring", "change", () => answer && paint());
  on("download", "click", download);
  on("status", "click", () => say(""));
  on("reset", "click", () => view?.reset());

  const divider = element("divider");
  const share = () => Number(divider.getAttribute("aria-valuenow")) / 100;
  on("divider", "pointerdown", (event) => divider.setPointerCapture(event.pointerId));
  on("divider", "pointermove", (event) => {
    const stage = element("stage").getBoundingClientRect();
    if (divider.hasPointerCapture(event.pointerId)) divide((event.clientX - stage.left) / stage.width);
  });
  on("divider", "keydown", (event) => {
    const to = { ArrowLeft: share() - 0.02, ArrowRight: share() + 0.02, Home: 0, End: 1 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    divide(to);
  });

  addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.dataset.dragging = "";
  });
  addEventListener("dragleave", (event) => event.relatedTarget ?? delete document.body.dataset.dragging);
  addEventListener("drop", (event) => {
    event.preventDefault();
    delete document.body.dataset.dragging;
    use_file(event.dataTransfer.files[0]);
  });
}

async function begin() {
  element("unlock").addEventListener("click", unlock);
  element("token").addEventListener("keydown", (event) => event.key === "Enter" && element("unlock").click());
  info = await (await ask("/info")).json();
  element("model").append(...info.models.map(({ name }) => option(name, name)));
  element("model").value = info.default_model;
  const named = (one) => option(one.name, `${one.extension} (${one.name.replace("application/", "")})`);
  element("type").append(...info.media_types.map(named));
  element("format").append(...info.media_types.map(named), option("image/png", "png (range images)"));
  element("format").value = "model/x-ply";
  show_model();
  listen();
}

begin().catch((error) => say(error.message, "bad"));
