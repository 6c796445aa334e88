"use strict";
// The fields of the page. A change of a field is sent to the server as {n, act, ...} in `bridge.request`; the server
// replies with the whole state of the page in `bridge.page_state`. Only the table of the certificate is inserted as
// HTML; the server has escaped its texts.
window.startExplorer = (bridge, figures) => {
  const $ = (id) => document.getElementById(id);
  const STEPS = 400, LARGEST_ROWS = 1 << 20, PATIENCE = 700, CALM = 300;
  let n = 0, timer = null, addressed = null, began = 0, state = null;

  // A long computation is shown with its seconds and can be stopped, whether a field, a click on a figure or the page
  // itself has requested it.
  const settled = () => state && state.idle && state.n >= n;
  function show_busy(busy) {
    for (const id of ["busy", "stop"]) $(id).hidden = !busy;
    if (busy) write("busy-text", `being solved for ${Math.round((performance.now() - began) / 1000)} s`);
  }
  function watch_time() {
    clearInterval(timer);
    began = performance.now();
    timer = setInterval(() => show_busy(!settled() && performance.now() - began >= PATIENCE), PATIENCE);
  }
  function ask(act, rest = {}) {
    n += 1;
    bridge.request = JSON.stringify({n, act, ...rest});
    watch_time();
  }

  // A slider has the whole numbers from 0 to STEPS, equal steps or equal factors of a parameter.
  const value_at = (dial, place) => {
    const share = place / STEPS;
    const value = dial.factors ? dial.low * (dial.high / dial.low) ** share : dial.low + (dial.high - dial.low) * share;
    return dial.whole ? Math.round(value) : Number(value.toPrecision(5));
  };
  const place_of = (dial, value) => Math.round(STEPS * Math.min(Math.max(dial.factors
    ? Math.log(value / dial.low) / Math.log(dial.high / dial.low) : (value - dial.low) / (dial.high - dial.low), 0), 1));
  const short = (value) => String(Number(value.toPrecision(7)));

  function new_dial(dial) {
    const box = document.createElement("div"), label = document.createElement("label");
    const slider = document.createElement("input"), number = document.createElement("input");
    box.className = "dial";
    label.htmlFor = `slider-${dial.name}`;
    label.textContent = dial.label + (dial.unit ? ` (${dial.unit})` : "");
    Object.assign(slider, {type: "range", min: 0, max: STEPS, step: 1, id: `slider-${dial.name}`});
    Object.assign(number, {type: "number", step: "any", id: `number-${dial.name}`});
    number.setAttribute("aria-label", `${label.textContent}, as a number`);
    box.append(label, slider, number);
    const set = (value) => {
      slider.setAttribute("aria-valuetext", short(value));
      ask("number", {name: dial.name, value});
    };
    slider.addEventListener("input", () => {
      const value = value_at(slider.dial, slider.valueAsNumber);
      number.value = short(value);
      set(value);
    });
    number.addEventListener("change", () => { if (Number.isFinite(number.valueAsNumber)) set(number.valueAsNumber); });
    $("dials").append(box);
  }

  function show_dials(dials) {
    const names = dials.map((dial) => `${dial.name} ${dial.unit}`).join();
    if ($("dials").dataset.names != names) {
      $("dials").dataset.names = names;
      $("dials").replaceChildren();
      dials.forEach(new_dial);
    }
    for (const dial of dials) {
      const slider = $(`slider-${dial.name}`);
      slider.dial = dial;
      slider.value = place_of(dial, dial.value);
      slider.setAttribute("aria-valuetext", short(dial.value));
      update_field($(`number-${dial.name}`), short(dial.value));
    }
  }

  // A field that is being typed in is not overwritten until its value on the server changes.
  function update_field(field, text) {
    if (document.activeElement !== field || field.dataset.sent !== text) field.value = text;
    field.dataset.sent = text;
  }

  function fill(select, pairs, chosen) {
    const options = JSON.stringify(pairs);
    if (select.dataset.pairs != options) {
      select.dataset.pairs = options;
      select.replaceChildren(...pairs.map(([value, text]) => new Option(text, value)));
    }
    select.value = chosen;
  }

  const write = (id, text) => { if ($(id).textContent !== text) $(id).textContent = text; };
  // A field whose text the server refused is not overwritten either.
  function write_field(id, value, problem) {
    const field = $(id), text = value == null ? "" : String(value);
    field.setAttribute("aria-invalid", problem ? "true" : "false");
    if (problem) field.dataset.sent = text;
    else update_field(field, text);
  }

  function show_fields() {
    const {scene, problems} = state;
    fill($("machine"), state.machines, scene.kind);
    fill($("family"), state.families, String(scene.family));
    $("floating-line").hidden = scene.floating == null;
    $("floating").checked = Boolean(scene.floating);
    $("laws").hidden = scene.fixed;
    for (const part of document.querySelectorAll("[data-steps]")) part.hidden = part.dataset.steps != scene.steps;
    write_field("spring", scene.spring, problems.spring);
    write_field("gravity", scene.gravity, problems.gravity);
    $("spring").disabled = Boolean(scene.rows);
    $("rows-shown").hidden = !scene.rows;
    write("rows-name", scene.rows ? scene.rows.name : "");
    $("branch").value = scene.rows ? scene.rows.branch : "";
    write_field("noise", scene.rows ? scene.rows.noise : "");
    fill($("along"), state.alongs, scene.along);
    write_field("launch", scene.launch);
    show_place(state.place);
    show_dials(state.dials);
  }

  // The slider goes through the hops of the family in order along the curve, also past a fold of the parameter.
  function show_place(place) {
    $("place-line").hidden = !place;
    if (!place) return;
    Object.assign($("place"), {max: place.of - 1, value: place.at});
    $("place").dataset.key = place.key;
    $("place").setAttribute("aria-valuetext", place.text);
  }

  function show() {
    for (const name of ["spring", "gravity", "rows"]) write(`${name}-problem`, state.problems[name] || "");
    write("problem", state.problems.page || "");
    $("problem").hidden = !state.problems.page;
    write("status", state.status);
    $("status").dataset.verdict = state.verdict;
    write("hop-title", state.title);
    if ($("certificate").dataset.sent !== state.table) {
      $("certificate").dataset.sent = state.table;
      $("certificate").innerHTML = state.table;
    }
    for (const id of ["certificate-title", "family-text", "map-text", "link-text", "python", "file"]) write(id, state[id]);
    for (const caption of document.querySelectorAll("[data-caption]")) {
      const name = caption.dataset.caption, text = state.captions[name] || "";
      caption.hidden = figures[name]?.visible === false;
      caption.classList.toggle("stale", state.stale.includes(name == "title" ? "machine" : name));
      if (caption.textContent !== text) caption.textContent = text;
    }
    $("launch-line").hidden = !figures.map.visible;
    for (const place of document.querySelectorAll("[data-figure]"))
      place.classList.toggle("stale", state.stale.includes(place.dataset.figure));
    for (const id of ["hop-title", "certificate-fold"]) $(id).classList.toggle("stale", state.stale.includes("machine"));
    $("undo").disabled = !state.undo;
    $("lowest").hidden = !state.lowest;
    $("save-rows").hidden = !state.scene.rows;
    $("save-file").disabled = state.scene.fixed;
    if ($("link").dataset.query !== state.link) {
      $("link").dataset.query = state.link;
      $("link").value = `${location.origin}/?${state.link}`;
      clearTimeout(addressed);  // browsers refuse to change the address as often as a slider moves
      addressed = setTimeout(() => history.replaceState(null, "", `?${$("link").dataset.query}`), CALM);
    }
    if (settled()) {
      clearInterval(timer);
      timer = null;
      show_busy(false);
    } else if (timer === null) watch_time();
    if (state.n >= n) show_fields();
    document.body.dataset.shown = state.shown;
  }

  function receive() {
    if (!bridge.page_state) return;
    state = JSON.parse(bridge.page_state);
    show();
  }

  const chosen = (id, act, value = (field) => field.value) =>
    $(id).addEventListener("change", () => ask(act, {value: value($(id))}));
  chosen("machine", "machine");
  chosen("family", "family", (field) => Number(field.value));
  chosen("floating", "floating", (field) => field.checked);
  chosen("spring", "spring");
  chosen("gravity", "gravity");
  chosen("along", "along");
  chosen("branch", "branch");
  $("place").addEventListener("input", () => {
    ask("place", {value: $("place").valueAsNumber, key: $("place").dataset.key});
  });
  const number_or_none = (field) => Number.isFinite(field.valueAsNumber) ? field.valueAsNumber : null;
  chosen("noise", "noise", number_or_none);
  chosen("launch", "launch", number_or_none);
  for (const id of ["undo", "lowest", "stop", "rows-away"]) $(id).addEventListener("click", () => ask(id));
  $("controls").addEventListener("submit", (event) => event.preventDefault());
  document.addEventListener("keydown", (event) => {
    const typed = event.target.matches?.("input:not([type=range], [type=checkbox])");
    if ((event.ctrlKey || event.metaKey) && !event.shiftKey && event.key.toLowerCase() == "z" && !typed) {
      event.preventDefault();
      ask("undo");
    }
  });

  function text_of(bytes) {
    if (bytes[0] == 0xff && bytes[1] == 0xfe) return new TextDecoder("utf-16le").decode(bytes);
    if (bytes[0] == 0xfe && bytes[1] == 0xff) return new TextDecoder("utf-16be").decode(bytes);
    try {
      return new TextDecoder("utf-8", {fatal: true}).decode(bytes);
    } catch {
      return new TextDecoder("windows-1252").decode(bytes);
    }
  }
  async function take_rows(file) {
    if (!file) return;
    if (file.size > LARGEST_ROWS) {
      write("rows-problem", `${file.name} has ${file.size} bytes, and at most ${LARGEST_ROWS} are taken`);
      return;
    }
    ask("rows", {name: file.name, text: text_of(new Uint8Array(await file.arrayBuffer()))});
  }
  $("rows").addEventListener("change", () => { take_rows($("rows").files[0]); $("rows").value = ""; });
  document.addEventListener("dragover", (event) => { event.preventDefault(); $("drop").classList.add("over"); });
  document.addEventListener("dragleave", () => $("drop").classList.remove("over"));
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    $("drop").classList.remove("over");
    take_rows(event.dataTransfer.files[0]);
  });

  function save(name, blob) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  }
  const save_text = (name, text) => save(name, new Blob([text], {type: "text/plain"}));
  $("save-file").addEventListener("click", () => save_text("machine.toml", $("file").textContent));
  $("save-rows").addEventListener("click", () => ask("give-rows"));
  for (const button of document.querySelectorAll("[data-copy]")) button.addEventListener("click", async () => {
    const from = $(button.dataset.copy);
    await navigator.clipboard.writeText(from.value ?? from.textContent);
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = "Copy"; }, 2000);
  });
  for (const button of document.querySelectorAll("[data-save]")) button.addEventListener("click", async () => {
    const kind = button.dataset.save, name = $("picture").value;
    hold(figures[name], false);
    await new Promise((resolve) => setTimeout(resolve, 100));
    const layer = await Bokeh.index.get(figures[name]).export(kind == "png" ? "png" : "svg");
    save(`${name}.${kind}`, await layer.to_blob());
  });

  // A figure out of view is not drawn: drawing one takes as long as finding a hop.
  const seen = new IntersectionObserver((entries) => {
    for (const {target, isIntersecting} of entries) hold(figures[target.dataset.figure], !isIntersecting);
  }, {rootMargin: "200px"});
  const hold = (figure, held) => {
    figure.setv({hold_render: held}, {sync: false});
    if (!held) Bokeh.index.get(figure).invalidate_layout();  // its legend may have grown meanwhile
  };
  for (const place of document.querySelectorAll("[data-figure]")) seen.observe(place);
  // On a phone a figure's tools are too small for fingers, and take a tenth of its width.
  const narrow = matchMedia("(max-width: 600px)");
  function show_tools() {
    for (const place of document.querySelectorAll("[data-figure]"))
      figures[place.dataset.figure].setv({toolbar_location: narrow.matches ? null : "right"}, {sync: false});
  }
  narrow.addEventListener("change", show_tools);
  if (narrow.matches) show_tools();

  // The tour comes up on the first visit alone, and by its button; a browser that stores nothing shows it each time.
  const steps = [...document.querySelectorAll("#tour li")], memory = (act, ...rest) => {
    try { return localStorage[act]("tour", ...rest); } catch { return null; }
  };
  let at = 0, pointed = null;
  function tour(step) {
    at = Math.max(step, 0);
    pointed?.classList.remove("shown-by-tour");
    $("tour").hidden = at >= steps.length;
    if ($("tour").hidden) {
      memory("setItem", "seen");
      return;
    }
    steps.forEach((each, k) => { each.hidden = k != at; });
    $("tour-back").hidden = at == 0;
    $("tour-next").textContent = at == steps.length - 1 ? "Done" : "Next";
    write("tour-count", `${at + 1} of ${steps.length}`);
    pointed = $(steps[at].dataset.at);
    pointed.classList.add("shown-by-tour");
    if (at) pointed.scrollIntoView({block: "center"}); else scrollTo(0, 0);
  }
  function end_tour() {
    tour(steps.length);
    $("tour-again").focus();
  }
  $("tour-next").addEventListener("click", () => at == steps.length - 1 ? end_tour() : tour(at + 1));
  $("tour-back").addEventListener("click", () => tour(at - 1));
  $("tour-end").addEventListener("click", end_tour);
  $("tour-again").addEventListener("click", () => { tour(0); $("tour-next").focus(); });
  document.addEventListener("keydown", (event) => { if (event.key == "Escape" && !$("tour").hidden) end_tour(); });
  if (!memory("getItem")) tour(0);

  // The workers of a page that was left are stopped before its session ends; a browser that restores the page from its
  // cache loads it anew.
  window.addEventListener("pagehide", () => { bridge.request = JSON.stringify({n, act: "leave"}); });
  window.addEventListener("pageshow", (event) => { if (event.persisted) location.reload(); });

  bridge.properties.page_state.change.connect(receive);
  bridge.properties.rows.change.connect(() => { if (bridge.rows) save_text(state.scene.rows.name, bridge.rows); });
  window.explorer = {ask, figures, get state() { return state; }, get settled() { return settled(); }};
  receive();
};
