"use strict";

// The page: forms, and two workers that compute. Whatever is decided about models and logs, the module decides.

/// Most bytes of all logs together: what the module can address, less what it needs to work on them.
const MOST_BYTES = 1 << 30;
/// How long typing has to rest before a model is read, ms.
const PAUSE = 250;
const KEPT = "tpm-page";

const at = (id) => document.getElementById(id);
const element = (name, properties = {}, ...children) => {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
};

// What runs in a worker. Its text is taken as it stands here: a page that was opened from a folder may not load a second file as a worker.
function work() {
  let compiled;
  const last = (instance) => {
    try {
      return said(instance, instance.exports.tpm_last_words());
    } catch {
      return "";
    }
  };
  const said = (instance, length) =>
    new TextDecoder().decode(new Uint8Array(instance.exports.memory.buffer, instance.exports.tpm_said(), length));
  const spent =
    "the browser has no memory left for this; give fewer or shorter logs, close other tabs, or use the command line, which needs less";
  const room = (instance, length) => {
    const at = instance.exports.tpm_room(length) >>> 0;
    if (at === 0 && length > 0) throw new Error(spent);
    return at;
  };
  const read = async (instance, file, progress) => {
    const begin = room(instance, file.size);
    const step = 1 << 24;
    for (let from = 0; from < file.size; from += step) {
      let part;
      try {
        part = new Uint8Array(await file.slice(from, Math.min(from + step, file.size)).arrayBuffer());
      } catch (fault) {
        throw new Error(`${file.name} cannot be read any more (${fault.message}); choose it again`);
      }
      new Uint8Array(instance.exports.memory.buffer, begin + from, part.length).set(part);
      progress(from + part.length);
    }
    instance.exports.tpm_log();
  };
  const answer = async (question, files, progress) => {
    // A module of its own for every question: nothing of an earlier one is left, however that ended.
    const module = await compiled;
    // The library that draws declares functions of a document, which a worker does not have; it never calls them.
    const imports = {};
    for (const { module: from, name } of WebAssembly.Module.imports(module)) {
      (imports[from] ||= {})[name] = () => { throw new Error(`${name} is not there in a worker`); };
    }
    const instance = await WebAssembly.instantiate(module, imports);
    const whole = files.reduce((sum, file) => sum + file.size, 0);
    let done = 0;
    for (const file of files) {
      await read(instance, file, (bytes) => progress({ read: done + bytes, whole }));
      done += file.size;
    }
    progress({ computing: true });
    const text = new TextEncoder().encode(JSON.stringify(question));
    const begin = room(instance, text.length);
    new Uint8Array(instance.exports.memory.buffer, begin, text.length).set(text);
    try {
      return JSON.parse(said(instance, instance.exports.tpm_ask()));
    } catch (fault) {
      const words = last(instance);
      if (words) throw new Error(words);
      if (/unreachable/.test(fault.message)) throw new Error(spent);
      throw new Error(`the browser gave up (${fault.message}); the command line may do it: tpm identify MODEL --log LOG`);
    }
  };
  self.onmessage = async ({ data }) => {
    if (data.engine) {
      compiled = WebAssembly.compile(data.engine);
      compiled.catch(() => {});
      return;
    }
    const { id, question, files } = data;
    try {
      self.postMessage({ id, answer: await answer(question, files, (progress) => self.postMessage({ id, progress })) });
    } catch (fault) {
      self.postMessage({ id, answer: { error: fault.message } });
    }
  };
}

/// The bytes of the module, unpacked once.
const engine = (async () => {
  const packed = Uint8Array.from(atob(self.tpmEngine.module), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
})();

/// A worker with the module. It answers one question after the other; stopping it leaves those that wait without an answer.
class Engine {
  constructor() {
    this.asked = new Map();
    this.count = 0;
  }

  async start() {
    if (this.worker) return;
    const address = URL.createObjectURL(new Blob([`(${work})()`], { type: "text/javascript" }));
    this.worker = new Worker(address);
    URL.revokeObjectURL(address);
    this.worker.onmessage = ({ data: { id, answer, progress } }) => {
      const asked = this.asked.get(id);
      if (progress) return asked?.progress?.(progress);
      this.asked.delete(id);
      asked?.done(answer);
    };
    // A worker that dies with its memory says no more than this.
    this.worker.onerror = (event) => {
      event.preventDefault();
      const waiting = [...this.asked.values()];
      this.stop();
      waiting.forEach(({ done }) =>
        done({ error: `the browser ended the computation (${event.message || "no reason given"}); it may have no memory left` }));
    };
    const worker = this.worker;
    worker.postMessage({ engine: await engine });
  }

  async ask(question, files = [], progress = undefined) {
    await this.start();
    const id = ++this.count;
    return new Promise((done) => {
      this.asked.set(id, { done, progress });
      this.worker.postMessage({ id, question, files });
    });
  }

  stop() {
    this.worker?.terminate();
    this.worker = undefined;
    this.asked.clear();
  }
}

const reader = new Engine();
const identifier = new Engine();

const state = { name: "model.tpm", logs: [], columns: [], described: null, proposed: {}, faulty: true, running: false, result: null };

/// Shows a fault at a place of the page, or takes it away; drawn diagnostics keep their columns.
function fault(id, text) {
  const place = at(id);
  place.hidden = !text;
  place.textContent = text;
  place.classList.toggle("drawn", /[╭│]/.test(text || ""));
}

const counted = (list, what) => `${list.length} ${what}${list.length === 1 ? "" : "s"}`;

const size = (bytes) =>
  bytes < 1e6 ? `${Math.max(bytes / 1e3, 0.1).toFixed(1)} kB` : bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(1)} GB`;

// ---- Files ----

const MODELS = /\.tpm$/i;
const ROBOTS = /\.(urdf|xml|mjcf|xacro)$/i;
const VALUES = /\.toml$/i;

/// Takes files in by what they are: models, robot descriptions, known values; everything else is a log.
async function take(files) {
  fault("log-fault", "");
  const logs = files.filter((file) => ![MODELS, ROBOTS, VALUES].some((kind) => kind.test(file.name)));
  for (const file of files.filter((file) => !logs.includes(file))) {
    if (file.size > MOST_BYTES / 64) {
      fault("log-fault", `${file.name} has ${size(file.size)}, which is no model; a log of such a name has to be called otherwise`);
      continue;
    }
    const text = await file.text().catch((why) => fault("log-fault", `${file.name} cannot be read (${why.message}); choose it again`));
    if (text === undefined) continue;
    if (MODELS.test(file.name)) write(file.name, text);
    else if (VALUES.test(file.name)) known(text);
    else await describe(file.name, text);
  }
  if (logs.length === 0) return;
  const whole = logs.reduce((sum, file) => sum + file.size, 0);
  if (whole > MOST_BYTES) {
    const what = logs.length === 1 ? `${logs[0].name} has` : "the logs have";
    fault("log-fault", `${what} ${size(whole)}, and this page takes ${size(MOST_BYTES)} together; the command line reads larger ones ` +
      "(tpm identify --allow-large), or give a shorter stretch");
    return;
  }
  const empty = logs.find((file) => file.size === 0);
  if (empty) {
    fault("log-fault", `${empty.name} is empty, or is a folder; choose the file of a log`);
    return;
  }
  state.logs = logs;
  await see();
}

/// Shows what the first log holds.
async function see() {
  const [log] = state.logs;
  at("logs").replaceChildren(
    ...state.logs.map((file) => {
      const remove = element("button", { type: "button", textContent: "remove", ariaLabel: `remove ${file.name}` });
      remove.onclick = () => {
        state.logs = state.logs.filter((other) => other !== file);
        see();
      };
      return element("li", {}, element("strong", { textContent: file.name }), ` ${size(file.size)} `, remove);
    }),
  );
  at("seen").hidden = true;
  fault("log-fault", "");
  state.columns = [];
  propose([], false);
  offer();
  if (!log) return;
  const note = element("li", { className: "soft", textContent: "reading ..." });
  at("logs").append(note);
  const seen = await reader.ask({ ask: "log", log: log.name }, [log], ({ read, whole }) => {
    note.textContent = read < whole ? `reading, ${Math.floor((100 * read) / whole)} %` : "looking at its columns ...";
  });
  if (state.logs[0] !== log) return;
  note.remove();
  // What cannot be read without a model may be readable with one, whose columns are known.
  if (seen.error) fault("log-fault", seen.error);
  else {
    state.columns = seen.columns;
    at("seen-head").textContent = `${seen.samples} samples, ${Number(seen.seconds.toPrecision(4))} s`;
    at("columns").replaceChildren(
      ...seen.columns.map(({ name, unit, quantity, constant }) =>
        element("tr", {}, ...[name, unit || "–", quantity + (constant ? ", which never changes" : "")].map((text) => element("td", { textContent: text })))),
    );
    at("seen-text").textContent = seen.text;
    at("column-names").replaceChildren(...seen.columns.map(({ name }) => element("option", { value: name })));
    at("seen").hidden = false;
    propose(seen.templates, seen.arm);
  }
  offer();
}

/// Buttons for the models that fit a log.
function propose(templates, arm) {
  at("templates").replaceChildren(
    ...templates.map(({ name, machine, model, signals }) => {
      const button = element("button", { type: "button" }, name.replace("_", " "), element("small", { textContent: machine }));
      button.onclick = () => {
        state.proposed = Object.fromEntries(signals.map(({ signal, column }) => [signal, column]));
        write(`${name}.tpm`, model);
      };
      return button;
    }),
  );
  at("templates-head").textContent = templates.length
    ? `Begin with the machine that it is, and change what differs${arm ? "; for an arm, drop its description (URDF or MJCF)" : ""}.`
    : arm ? "Drop the arm's description (URDF or MJCF), or write the equations of motion."
      : "Write the equations of motion; with a log, models to begin with are proposed here.";
}

/// A robot description as a model.
async function describe(name, text) {
  const imported = await reader.ask({ ask: "import", description: { name, text } });
  if (imported.error) return fault("log-fault", imported.error);
  write(name.replace(/\.[^.]*$/, ".tpm"), imported.model);
  known(imported.known);
  if (imported.remarks.length) fault("log-fault", imported.remarks.join("\n"));
}

function known(text) {
  at("known").value = text;
  at("more").open = true;
  at("known").scrollTop = 0;
}

// ---- Model ----

/// What is known of a text that was not read yet.
const NOTHING = { findings: [], omitted: 0, faulty: true, model: null };

/// Another model: what was said of the one before is forgotten.
function write(name, text) {
  state.name = name;
  at("model").value = text;
  at("model").scrollTop = 0;
  fault("fault", "");
  number();
  show(NOTHING, text);
  check();
}

/// The numbers of the lines beside the text, and the marks under it, where the text is.
function follow() {
  at("numbers").scrollTop = at("model").scrollTop;
  at("marks").scrollTop = at("model").scrollTop;
  at("marks").scrollLeft = at("model").scrollLeft;
}

function number() {
  const lines = at("model").value.split("\n").length;
  at("numbers").textContent = Array.from({ length: lines }, (_, line) => line + 1).join("\n") + "\n\n";
  at("marks").replaceChildren();
  follow();
}

let checks = 0;
async function check() {
  const own = ++checks;
  const text = at("model").value;
  keep();
  if (!text.trim()) {
    show(NOTHING, text);
    return;
  }
  const found = await reader.ask({ ask: "check", model: { name: state.name, text } });
  // Whatever was typed since is read next.
  if (own !== checks) return;
  show(found.error ? { ...NOTHING, findings: [{ error: true, from: 0, to: 0, line: 1, column: 1, message: found.error, others: [] }] } : found, text);
}

/// Shows what is said of a model, and the fields of its signals.
function show({ findings, omitted, faulty, model }, text) {
  state.faulty = faulty || !model;
  state.described = model || state.described;
  const marked = [];
  let end = 0;
  for (const { from, to, error } of [...findings].sort((a, b) => a.from - b.from)) {
    if (from < end || to <= from) continue;
    marked.push(text.slice(end, from), element("mark", { className: error ? "error" : "", textContent: text.slice(from, to) }));
    end = to;
  }
  at("marks").replaceChildren(...marked, text.slice(end) + "\n\n");
  follow();
  at("findings").replaceChildren(
    ...findings.map(({ error, from, to, line, column, message, others }) => {
      const go = element("button", { type: "button", className: "plain", textContent: `line ${line}, column ${column}` });
      go.onclick = () => {
        at("model").focus();
        at("model").setSelectionRange(from, to);
        at("model").scrollTop = Math.max(0, (line - 4) * parseFloat(getComputedStyle(at("model")).lineHeight));
      };
      const beside = others.map((other) => `\nline ${other.line}: ${other.message}`).join("");
      return element("li", { className: error ? "error" : "" }, go, message + beside);
    }),
    ...(omitted ? [element("li", { textContent: `and ${omitted} more` })] : []),
  );
  const errors = findings.filter(({ error }) => error).length + omitted;
  at("verdict").textContent = state.faulty
    ? errors === 1 ? "One fault." : errors ? `${errors} faults.` : ""
    : `${model.name}: ${counted(model.parameters, "parameter")}, ${counted(model.coordinates, "coordinate")}, ${counted(model.inputs, "input")}; no fault.`;
  if (model) signals(model);
  offer();
}

// ---- Signals ----

const FIELDS = ["column", "factor", "offset", "delay"];

/// The fields of a model's signals; what was typed for a signal of the same name stays.
function signals(model) {
  const typed = settings().signals;
  const inputs = new Set(model.inputs.map(({ name }) => name));
  const rates = model.coordinates.map(({ name, unit }) => ({ name: `dot(${name})`, unit: unit && `${unit}/s` }));
  const all = [{ name: "t_s", unit: "s" }, ...model.coordinates, ...rates, ...model.inputs];
  at("signal-rows").replaceChildren(
    ...all.map(({ name, unit }) => {
      const field = (kind) => {
        const of = name === "t_s" ? "the time" : name;
        const input = element("input", { value: state.proposed[name] && kind === "column" ? state.proposed[name] : typed[name]?.[kind] || "", ariaLabel: `${kind} of ${of}` });
        input.dataset.signal = name;
        input.dataset.kind = kind;
        input.placeholder = kind === "column" ? (name === "t_s" ? "found" : name) : kind === "factor" ? "by its unit" : "0";
        if (kind === "column") input.setAttribute("list", "column-names");
        input.spellcheck = false;
        const label = kind === "delay" ? "delay, s" : kind;
        const cell = element("td", {}, ...(kind === "delay" && !inputs.has(name) ? [] : [input]));
        if (cell.firstChild) cell.dataset.label = label;
        return cell;
      };
      return element("tr", {}, element("td", { textContent: name === "t_s" ? "time" : name }), element("td", { textContent: unit || "–" }), ...FIELDS.map(field));
    }),
  );
  state.proposed = {};
  at("signals").hidden = false;
  at("signals-none").hidden = true;
}

const PLAIN = ["hold", "sample_time", "from_sample", "period", "harmonics", "domain", "weights", "refine", "known", "held", "constants"];

/// All fields as the module takes them: as they are typed.
function settings() {
  const signals = {};
  for (const input of at("signal-rows").querySelectorAll("input")) {
    (signals[input.dataset.signal] ||= {})[input.dataset.kind] = input.value;
  }
  return { signals, ...Object.fromEntries(PLAIN.map((id) => [id, at(id).value])) };
}

// ---- Identification ----

/// Whether there is something to identify from, and with what.
function offer() {
  at("go").disabled = state.running || state.faulty || state.logs.length === 0;
  if (state.running) return;
  at("busy").textContent = state.logs.length === 0 ? "Choose a log first." : state.faulty ? "Choose or write a model first." : "";
}

const today = () => new Date().toISOString().slice(0, 10);

async function identify() {
  const model = { name: state.name, text: at("model").value };
  const logs = state.logs;
  const asked = { ask: "identify", model, logs: logs.map(({ name }) => name), settings: settings(), title: at("title").value, author: at("author").value, date: today() };
  running(true);
  fault("fault", "");
  at("result").hidden = true;
  const began = performance.now();
  let doing = "starting";
  const tell = () => {
    at("busy").textContent = `${doing}, ${((performance.now() - began) / 1000).toFixed(0)} s`;
  };
  const clock = setInterval(tell, 200);
  tell();
  state.stopped = () => {
    clearInterval(clock);
    identifier.stop();
    running(false);
    at("busy").textContent = "Stopped.";
  };
  const answer = await identifier.ask(asked, logs, (progress) => {
    doing = progress.computing ? "identifying" : `reading, ${Math.floor((100 * progress.read) / progress.whole)} %`;
  });
  clearInterval(clock);
  running(false);
  const seconds = (performance.now() - began) / 1000;
  at("busy").textContent = answer.error ? "" : `Done in ${seconds.toPrecision(2)} s.`;
  if (answer.error) return fault("fault", answer.error);
  state.result = { ...answer, model };
  present(state.result);
}

function running(now) {
  state.running = now;
  at("stop").hidden = !now;
  offer();
  keep();
}

/// Shows a result, and what can be taken away from it.
function present({ result, text, report, shortfall, remarks, model }) {
  const headline = at("headline");
  headline.classList.toggle("short", Boolean(shortfall));
  headline.textContent = shortfall ? `Not complete: ${shortfall}` : "Identified. The report says how sure it is.";
  at("remarks").replaceChildren(...remarks.map((remark) => element("li", { textContent: remark })));
  at("text").textContent = text;
  fault("code-fault", "");
  const stem = model.name.replace(/\.tpm$/i, "");
  const link = (label, name, content, type) => {
    const button = element("button", { type: "button", textContent: label });
    button.onclick = () => save(name, content, type);
    return button;
  };
  const code = (label, language) => {
    const button = element("button", { type: "button", textContent: label });
    button.onclick = async () => {
      fault("code-fault", "");
      const made = await reader.ask({ ask: "generate", model, language, result });
      if (made.error) return fault("code-fault", made.error);
      for (const { name, text } of made.files) save(name, text, "text/plain");
      if (made.remarks.length) fault("code-fault", made.remarks.join("\n"));
    };
    return button;
  };
  at("downloads").replaceChildren(
    link("Report", `${stem}.html`, report, "text/html"),
    link("Result (JSON)", "result.json", result, "application/json"),
    link("Model", model.name, model.text, "text/plain"),
    code("Code in C", "c"),
    code("Code in Rust", "rust"),
  );
  // The report has no script, and gets no right to run one; the page may see how high it is.
  const frame = at("report");
  frame.onload = () => {
    const height = frame.contentDocument?.documentElement.scrollHeight;
    if (height) frame.style.height = `${height + 4}px`;
  };
  frame.style.height = "";
  frame.srcdoc = report;
  at("result").hidden = false;
}

function save(name, content, type) {
  const address = URL.createObjectURL(new Blob([content], { type: `${type};charset=utf-8` }));
  element("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 60000);
}

// ---- What is kept when the tab is closed ----

/// Keeps the model and whether something was running. A browser that keeps nothing is no fault.
function keep() {
  try {
    localStorage.setItem(KEPT, JSON.stringify({ name: state.name, text: at("model").value, running: state.running, logs: state.logs.map(({ name }) => name) }));
  } catch {}
}

function restore() {
  try {
    const kept = JSON.parse(localStorage.getItem(KEPT) || "null");
    if (!kept?.text) return;
    if (kept.running) {
      fault("log-fault", `the page was closed while it identified, and the identification ended with it; the model is here again, choose ${kept.logs.join(", ")} again`);
    }
    write(kept.name, kept.text);
  } catch {}
}

// ---- Beginning ----

function begin() {
  at("version").textContent = self.tpmEngine.version;
  at("choose").onclick = () => at("files").click();
  at("files").onchange = ({ target }) => {
    const files = [...target.files];
    // The same file may be chosen again after it was changed.
    target.value = "";
    take(files);
  };
  at("sample").onclick = async ({ target }) => {
    target.disabled = true;
    const sample = await reader.ask({ ask: "sample" });
    target.disabled = false;
    if (sample.error) return fault("log-fault", sample.error);
    at("hold").value = "zoh";
    state.logs = [new File([sample.log.text], sample.log.name)];
    write(sample.model.name, sample.model.text);
    await see();
  };
  for (const kind of ["dragenter", "dragover"]) {
    addEventListener(kind, (event) => {
      event.preventDefault();
      document.body.classList.add("over");
    });
  }
  addEventListener("dragleave", (event) => {
    if (!event.relatedTarget) document.body.classList.remove("over");
  });
  addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("over");
    const files = [...event.dataTransfer.files];
    if (files.length) take(files);
  });
  addEventListener("beforeunload", (event) => {
    if (state.running) event.preventDefault();
  });
  let rest;
  at("model").oninput = () => {
    number();
    at("go").disabled = true;
    clearTimeout(rest);
    rest = setTimeout(check, PAUSE);
  };
  at("model").onscroll = follow;
  new ResizeObserver(() => {
    at("numbers").style.height = `${at("model").offsetHeight}px`;
    follow();
  }).observe(at("model"));
  addEventListener("resize", () => at("report").onload?.());
  at("go").onclick = identify;
  at("stop").onclick = () => state.stopped?.();
  restore();
  offer();
  document.querySelector("main").hidden = false;
}

// What a browser lacks is said before anything is asked of it.
if (!self.tpmEngine) {
  fault("trouble", "the file engine.js is not beside this page; take the whole folder");
} else if (!self.WebAssembly || !self.DecompressionStream || !self.Worker) {
  fault("trouble", "this browser is too old for this page, which needs WebAssembly, workers and DecompressionStream (any browser from 2023 on)");
} else {
  engine.then(begin, (why) => fault("trouble", `engine.js is damaged (${why.message}); take the whole folder again`));
}
