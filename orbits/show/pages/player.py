"""The animation of a hop, which JavaScript draws in the browser alone from heights against time."""

from typing import Any

from .bokeh_figures import GREY, PAGE, bokeh

# A finger needs a handle that is larger than a pointer's.
LARGE_HANDLES = (
    """.noUi-target .noUi-handle { width: 24px; height: 24px; right: -12px; top: -9px; border-radius: 12px; }"""
)
# One function for everything that calls it: `cause` is "layout", "data", "button" or "place". The state is on the
# source of the motion. Glyphs that are redrawn in each frame are changed in place and not reported
# to a server (`change.emit` and `sync: false`), or there would be a message for each frame.
PLAY = (
    f"const GREY = '{GREY}';"
    + """
const player = motion.player ??= {share: 0, lap: 0, last: null, drawn: 0, reported: 0, looping: false, place: 0};
const ZIGZAG = [0, 0, ...Array(7).fill([9, -9]).flat(), 0, 0];

function draw() {
  const {time, height, speed, colour, name} = masses.data, {drawn} = motion.data;
  if (!time.length || drawn.length != time.length || machine.inner_width <= 0) return;
  const t = time[0], end = t[t.length - 1], now = player.share * end;
  let low = 0, high = t.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (t[middle] <= now) low = middle; else high = middle;
  }
  const weight = (now - t[low]) / (t[high] - t[low] || 1);
  const at = row => row[low] + weight * (row[high] - row[low]);
  const y = Array.from(drawn, at), place = i => i < 0 ? 0 : y[i];
  const pixel = (machine.x_range.end - machine.x_range.start) / machine.inner_width;
  const up = (machine.y_range.end - machine.y_range.start) / machine.inner_height;
  springs.data.xs = springs.data.lower.map(() => ZIGZAG.map(x => x * pixel));
  springs.data.ys = springs.data.lower.map((lower, i) => {
    const from = place(lower), to = place(springs.data.upper[i]);
    return ZIGZAG.map((_, k) => from + (to - from) * k / (ZIGZAG.length - 1));
  });
  knees.data.ys = knees.data.lower.map((lower, i) => {
    const from = place(lower), to = place(knees.data.upper[i]);
    return [from, (from + to) / 2, to];
  });
  knees.data.xs = knees.data.ys.map(([from, _, to], i) => {
    const aside = Math.sqrt(Math.max(knees.data.link[i] ** 2 - ((to - from) / 2) ** 2, 0));
    return [0, aside / up * pixel, 0];
  });
  const flat = plane.data.points.length > 0;
  if (flat) drawInPlane(up, pixel);
  const last = y.length - 1, right = y.map((_, i) => (i + y.length) % 2 == 0);
  Object.assign(bodies.data, {
    x: y.map(() => flat ? NaN : 0), y, colour, name,
    height: Array.from(height, at), speed: Array.from(speed, at),
    marker: y.map((_, i) => i < last || !last ? "circle" : "dash"), size: y.map((_, i) => i < last ? 20 : 40),
    aside: right.map(is => is ? 24 : -24), align: right.map(is => is ? "left" : "right"),
    time: y.map(() => now), force: y.map(() => force.data.force.length ? at(force.data.force) : NaN),
  });
  for (const source of [springs, knees, bodies, ...(flat ? [outlines, dots] : [])]) source.change.emit();
}

function drawInPlane(up, pixel) {
  const [points] = plane.data.points, [cycles] = plane.data.cycles, [middle] = plane.data.middle;
  const sizes = Array.from(outlines.data.size), {ends, closed, colour} = outlines.data;
  const times = points.length / 2 / sizes.reduce((sum, size) => sum + size, 0);
  const place = ((player.lap % cycles) + player.share) / cycles * (times - 1);
  const low = Math.min(Math.floor(place), times - 2), weight = place - low;
  let begin = 0, trail = 0;
  const across = x => (x - middle) / up * pixel, moved = player.lap % cycles + player.share;
  const between = (row, now, size) => row[now] + weight * (row[now + size] - row[now]);
  const [trails] = plane.data.trails, [advance] = plane.data.advance, [marks] = plane.data.marks;
  const length = trails.length / sizes.filter(size => !size).length;
  const paths = sizes.map((size, i) => {
    if (!size) {  // the path until now, as one who goes on sees it
      const own = trails.slice(length * trail, length * ++trail), last = length / 2 - times + low;
      const known = Array.from({length: last + 1}, (_, k) => [own[2 * k], own[2 * k + 1]]);
      known.push([0, 1].map(j => between(own, 2 * last + j, 2)));
      for (const point of known) point[0] = across(point[0] - advance * moved);
      const seen = known.filter(([x]) => Math.abs(x) < 1);
      return [seen.map(([x]) => x), seen.map(([, y]) => y)];
    }
    const from = begin + 2 * size * low, xs = [], ys = [];
    for (let k = 0; k < size; k++) {
      const [x, y] = [0, 1].map(j => between(points, from + 2 * k + j, 2 * size));
      xs.push(across(x));
      ys.push(y);
    }
    begin += 2 * size * times;
    return closed[i] ? [[...xs, xs[0]], [...ys, ys[0]]] : [xs, ys];
  });
  outlines.data.xs = paths.map(([xs]) => xs);
  outlines.data.ys = paths.map(([, ys]) => ys);
  const ended = paths.flatMap(([xs, ys], i) => !ends[i] ? [] :
    [0, xs.length - 1].map(k => [xs[k], ys[k], colour[i], 12]));
  const feet = marks.map(x => across(x - advance * moved)).filter(x => Math.abs(x) < 1);
  ended.push(...feet.map(x => [x, 0, GREY, 6]));
  ["x", "y", "colour", "size"].forEach((name, k) => { dots.data[name] = ended.map(end => end[k]); });
}

function report(now) {
  player.reported = now;
  player.place = Math.round(1000 * player.share) / 1000;
  slider.setv({value: player.place}, {sync: false});
}

function step(now) {
  if (!button.active || machine.document == null) {
    player.looping = false;
    return;
  }
  const passed = player.last == null ? 0 : Math.min(now - player.last, 100);
  player.last = now;
  player.share += passed / 1000 * speed.value;
  player.lap += Math.floor(player.share);
  player.share %= 1;
  if (now - player.drawn > 30) {
    player.drawn = now;
    draw();
    if (now - player.reported > 150) report(now);
  }
  requestAnimationFrame(step);
}

if (cause == "place") {
  if (Math.abs(slider.value - player.place) < 5e-4) return;  // the animation itself has moved it
  player.share = slider.value >= 1 ? 1 - 1e-9 : slider.value;
  button.active = false;
}
if (cause == "layout" && player.last == null && matchMedia("(prefers-reduced-motion: reduce)").matches)
  button.active = false;
button.label = button.active ? "Pause" : "Play";
draw();
if (button.active && !player.looping) {
  player.looping = true;
  player.last = null;
  requestAnimationFrame(step);
}
"""
)


def new_player(machine: Any, **sources: Any) -> Any:
    """A row of widgets, play and pause, speed, and the place in the cycle, that animates a machine.

    machine : the figure
    sources : "masses", with rows of time, height and speed of each; "motion", with their drawn heights, which is set
        last; "force"; "springs" and "knees", with the numbers of the masses that they join, -1 for the ground;
        "bodies", the drawn marks of the masses; and, of a machine in the plane, "plane", its motion as one row of
        numbers, "outlines" and their "dots"

    Bokeh rebuilds a legend whenever a model that its renderers refer to changes, and a callback refers to all of its
    arguments; so the source of a figure with a legend has no callback.
    """
    models = bokeh("models")
    button = models.Toggle(label="Pause", active=True, width=72, height=44, align="end", name="play")
    style = {"stylesheets": [models.InlineStyleSheet(css=LARGE_HANDLES)]}
    speed = models.Slider(
        start=0.05, end=2, step=0.05, value=PAGE.cycles_per_second, title="Cycles/s", width=120, name="speed", **style
    )
    slider = models.Slider(
        start=0, end=1, step=0.001, value=0, title="Place", sizing_mode="stretch_width", format="0.000",
        min_width=100, name="place", **style,
    )  # fmt: skip
    models_by_name = dict(machine=machine, button=button, speed=speed, slider=slider, **sources)
    causes = [(machine, "inner_width", "layout"), (machine, "inner_height", "layout")]
    causes += [(sources["motion"], "data", "data"), (button, "active", "button"), (slider, "value", "place")]
    for model, name, cause in causes:
        model.js_on_change(name, models.CustomJS(args={**models_by_name, "cause": cause}, code=PLAY))
    return bokeh("layouts").row(button, speed, slider, sizing_mode="stretch_width", name="player")
