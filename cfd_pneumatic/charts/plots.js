// SPDX-License-Identifier: Apache-2.0
// Plots with zoom and cursor in place of the static pictures of a page, from the data of `charts/element.py`.
'use strict';
(() => {
const MOST_DOTS = 800;          // samples in a width of 1000 px up to which samples are dots
const MARGIN = 0.08;            // share of the range above and below the curves
const TAIL = 0.005;             // share of the samples beyond either end of the usual range
const ROBUST_MARGIN = 0.35, LEAST_SPIKE = 2.5;
const MOST_DRAWN_DOTS = 3000;
const ZOOM = 2, NARROWEST = 1e-4;  // factor of a zoom step; narrowest view as a share of the whole
const AXIS_WIDTH = 58, ROOM = {above: 26, below: 44};

const clocks = new Map();       // charts that share cursor and zoom, by their clock
const colour = text => {
  const name = /^var\((--[\w-]+)\)$/.exec(text);
  const style = getComputedStyle(document.documentElement);
  const value = name ? style.getPropertyValue(name[1]).trim() : text === 'currentColor' ? '' : text;
  return value || style.color;
};

// data

async function decoded({low, step, size, bytes, text}) {
  const packed = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const values = new Float64Array(size), modulus = 256 ** bytes;
  for (let i = 0, count = 0; i < size; i++) {
    for (let plane = 0; plane < bytes; plane++) count += planes[plane * size + i] * 256 ** plane;
    count %= modulus;
    values[i] = low + step * count;
  }
  return values;
}

function firstFrom(x, value) {  // index of the first value that is not smaller
  let low = 0, high = x.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (x[middle] < value) low = middle + 1; else high = middle;
  }
  return low;
}

function thinned(x, y, begin, end, columns) {  // lowest and highest point of each column, in order
  if (end - begin <= 2 * columns) return [x.slice(begin, end), y.slice(begin, end)];
  const xs = [], ys = [];
  for (let column = 0; column < columns; column++) {
    const first = begin + Math.floor((end - begin) * column / columns);
    const last = begin + Math.floor((end - begin) * (column + 1) / columns);
    let low = first, high = first;
    for (let i = first + 1; i < last; i++) {
      if (y[i] < y[low]) low = i;
      if (y[i] > y[high]) high = i;
    }
    for (const i of low < high ? [low, high] : low > high ? [high, low] : [low]) { xs.push(x[i]); ys.push(y[i]); }
  }
  return [xs, ys];
}

function rangeOf(panel, values, full) {  // as `Panel.range` of `charts/chart.py`, of the visible values
  const references = panel.levels.map(level => level[0]);
  if (panel.band !== null) references.push(-panel.band, panel.band);
  let low = Math.min(...references), high = Math.max(...references), usualLow = low, usualHigh = high;
  for (const visible of values) {
    if (!visible.length) continue;
    const sorted = Float64Array.from(visible).sort();
    const quantile = share => sorted[Math.round(share * (sorted.length - 1))];
    const [begin, end] = [quantile(TAIL), quantile(1 - TAIL)], margin = ROBUST_MARGIN * (end - begin);
    low = Math.min(low, sorted[0]); high = Math.max(high, sorted[sorted.length - 1]);
    usualLow = Math.min(usualLow, begin - margin); usualHigh = Math.max(usualHigh, end + margin);
  }
  if (!(low <= high)) return [0, 1];
  const span = high - low || Math.abs(high) || 1;
  const all = [low - MARGIN * span, high + (MARGIN + panel.headroom) * span];
  const usual = LEAST_SPIKE * (usualHigh - usualLow);
  return panel.robust && !full && 0 < usual && usual < all[1] - all[0] ? [usualLow, usualHigh] : all;
}

// a plot

class Plot {
  static async of(figure) {
    const data = JSON.parse(figure.querySelector('script').textContent);
    const columns = await Promise.all(data.columns.map(decoded));
    Object.assign(data, {marks: [], windows: [], clock: '', panels: [], columns: [], ...data});
    for (const panel of data.panels) {
      Object.assign(panel, {title: '', headroom: 0, robust: false, band: null, levels: [], labels: [], curves: [], ...panel});
      for (const curve of panel.curves) {
        [curve.x, curve.y] = [columns[curve.x], columns[curve.y]];
        curve.times = curve.times === undefined ? null : columns[curve.times];
      }
    }
    return new Plot(figure, data);
  }

  constructor(figure, data) {
    Object.assign(this, {figure, data, view: data.span, full: false, cursor: null, within: null});
    this.live = document.createElement('div');
    this.live.className = 'live';
    figure.querySelector('.static').after(this.live);
    this.build();
    figure.classList.add('live-chart');
    new ResizeObserver(() => this.draw()).observe(this.live);
  }

  get group() { return this.data.clock ? clocks.get(this.data.clock) : [this]; }
  get hasCursor() { return this.data.panels.some(panel => panel.curves.some(curve => curve.name)); }

  build() {
    this.live.replaceChildren();
    if (this.hasCursor) this.addControls();
    const canvas = document.createElement('div');
    canvas.setAttribute('role', 'img');
    canvas.setAttribute('aria-label', this.data.label);
    this.live.append(canvas);
    this.range = new Bokeh.Range1d({start: this.view[0], end: this.view[1]});
    this.panels = this.data.panels.map((panel, rank) => this.panelOf(panel, rank === this.data.panels.length - 1));
    const children = this.panels.map(panel => panel.plot);
    Bokeh.Plotting.show(new Bokeh.Column({children, sizing_mode: 'stretch_width', spacing: 0}), canvas);
    this.range.properties.start.change.connect(() => this.follow());
    this.range.properties.end.change.connect(() => this.follow());
    this.draw();
  }

  panelOf(panel, isLast) {
    const ink = colour('currentColor'), rule = colour('var(--rule)'), muted = colour('var(--muted)');
    const values = new Bokeh.Range1d({start: panel.range[0], end: panel.range[1]});
    const tools = this.hasCursor && !matchMedia('(pointer: coarse)').matches
      ? [new Bokeh.BoxZoomTool({dimensions: 'width'})] : [];
    const plot = Bokeh.Plotting.figure({
      height: panel.height + ROOM.above + (isLast ? ROOM.below : 14), sizing_mode: 'stretch_width', tools,
      toolbar_location: null, x_range: this.range, y_range: values, title: panel.title, min_border_left: AXIS_WIDTH,
      min_border_right: 14, background_fill_color: null, border_fill_color: null, outline_line_color: null,
      x_axis_label: isLast ? this.data.axis : null, lod_threshold: null,
    });
    const font = getComputedStyle(document.body).fontFamily;
    Object.assign(plot.title, {text_color: ink, text_font: font, text_font_size: '12px', text_font_style: 'normal'});
    for (const axis of [plot.xaxis, plot.yaxis].flat()) {
      for (const part of axis instanceof Array ? axis : [axis]) {
        Object.assign(part, {
          axis_line_color: muted, major_tick_line_color: muted, minor_tick_line_color: null,
          major_label_text_color: muted, major_label_text_font: font, axis_label_text_color: muted,
          axis_label_text_font: font, axis_label_text_font_style: 'normal', axis_label_text_font_size: '12px',
        });
      }
    }
    plot.yaxis.ticker = new Bokeh.BasicTicker({desired_num_ticks: Math.max(2, Math.round(panel.height / 28))});
    for (const grid of [plot.xgrid, plot.ygrid].flat()) Object.assign(grid, {grid_line_color: rule, grid_line_alpha: 0.5});
    if (panel.band !== null) {
      plot.add_layout(new Bokeh.BoxAnnotation({
        bottom: -panel.band, top: panel.band, fill_color: ink, fill_alpha: 0.08, line_color: null}));
    }
    const line = (dimension, location, line_color, line_dash) =>
      plot.add_layout(new Bokeh.Span({dimension, location, line_color, line_dash, line_width: 1}));
    for (const [height, tone] of panel.levels) line('width', height, colour(tone), [4, 3]);
    for (const mark of this.data.marks) line('height', mark, muted, [2, 3]);
    for (const [begin, text] of panel.labels) {
      plot.add_layout(new Bokeh.Label({
        x: begin, y: panel.height - 4, y_units: 'screen', x_offset: 4, text, text_color: muted, text_font: font,
        text_font_size: '11px', text_baseline: 'top'}));
    }
    const curves = panel.curves.map(curve => {
      const source = new Bokeh.ColumnDataSource({data: {x: [], y: []}});
      const tone = colour(curve.colour);
      const stroke = plot.line({field: 'x'}, {field: 'y'}, {source, line_color: tone, line_width: curve.width});
      const dots = plot.scatter({field: 'x'}, {field: 'y'}, {source, size: 4, fill_color: tone, line_color: null});
      return {curve, source, stroke, dots};
    });
    const cursor = new Bokeh.Span({dimension: 'height', location: 0, line_color: muted, visible: false});
    plot.add_layout(cursor);
    if (this.hasCursor) {
      plot.on_event('mousemove', event => this.point(event.x));
      plot.on_event('tap', event => this.point(event.x));
      plot.on_event('doubletap', () => this.show(...this.data.span));
    }
    return {panel, plot, values, curves, cursor};
  }

  addControls() {
    const bar = document.createElement('div');
    bar.className = 'controls';
    const button = (text, act, pressed) => {
      const element = document.createElement('button');
      Object.assign(element, {type: 'button', textContent: text});
      if (pressed !== undefined) element.setAttribute('aria-pressed', String(pressed));
      element.addEventListener('click', () => act(element));
      bar.append(element);
    };
    if (this.data.wide) {
      button('Zoom in', () => this.zoom(1 / ZOOM));
      button('Zoom out', () => this.zoom(ZOOM));
      button('Show all', () => this.show(...this.data.span));
    }
    for (const [title, begin, end] of this.data.windows) {
      const margin = 0.05 * (end - begin);
      button(title, () => this.show(begin - margin, end + margin));
    }
    if (this.data.panels.some(panel => panel.full)) {
      button('Full range', element => {
        this.full = !this.full;
        element.setAttribute('aria-pressed', String(this.full));
        this.draw();
      }, this.full);
    }
    this.reading = document.createElement('output');
    this.reading.textContent = this.data.wide
      ? 'Point at a curve to read its values. Drag to zoom; keys: arrows, + and −, Home.' : 'Point at a curve.';
    this.live.append(bar, this.reading);
    Object.assign(this.live, {tabIndex: 0, onkeydown: event => this.press(event)});
    this.live.setAttribute('role', 'group');
    this.live.setAttribute('aria-label', 'Plot with zoom and cursor');
  }

  press(event) {
    const [begin, end] = this.view, step = (end - begin) / (event.shiftKey ? 20 : 200);
    const at = this.cursor ?? (begin + end) / 2;
    const act = {
      ArrowLeft: () => this.point(at - step), ArrowRight: () => this.point(at + step),
      '+': () => this.zoom(1 / ZOOM), '-': () => this.zoom(ZOOM), Home: () => this.show(...this.data.span),
    }[event.key];
    if (act && event.target === this.live) { event.preventDefault(); act(); }
  }

  // zoom

  zoom(factor) {
    const [begin, end] = this.view;
    const inside = this.cursor !== null && this.cursor > begin && this.cursor < end;
    const at = inside ? this.cursor : (begin + end) / 2;
    this.show(at + factor * (begin - at), at + factor * (end - at));
  }

  show(begin, end) {
    const [first, last] = this.data.span, narrowest = NARROWEST * (last - first);
    if (end - begin < narrowest) [begin, end] = [(begin + end - narrowest) / 2, (begin + end + narrowest) / 2];
    this.range.setv({start: Math.max(begin, first), end: Math.min(end, last)});
    this.follow();
  }

  follow() {  // what the range shows now, also in the other charts of the clock
    const {start, end} = this.range;
    if (start === this.view[0] && end === this.view[1]) return;
    this.view = [start, end];
    for (const other of this.group) other.see(this, start, end);
    this.draw();
  }

  see(source, start, end) {
    if (this === source) return;
    this.within = [start, end];
    if (this.hasCursor && (this.view[0] !== start || this.view[1] !== end)) {
      this.view = [start, end];
      this.range.setv({start, end});
    }
    this.draw();
  }

  draw() {
    if (this.pending) return;
    this.pending = requestAnimationFrame(() => {
      this.pending = 0;
      const width = Math.max(this.live.clientWidth - AXIS_WIDTH, 100);
      for (const {panel, values, curves} of this.panels) {
        const visible = curves.map(entry => this.drawCurve(entry, width));
        const [start, end] = rangeOf(panel, visible, this.full);
        values.setv({start, end});
      }
    });
  }

  drawCurve({curve, source, stroke, dots}, width) {  // return the visible values
    const {x, y, times} = curve;
    let [xs, ys] = [x, y], isDots = curve.style === 'dots', visible = y;
    if (!isDots) {
      const begin = Math.max(firstFrom(x, this.view[0]) - 1, 0), end = Math.min(firstFrom(x, this.view[1]) + 1, x.length);
      isDots = curve.style === 'samples' && end - begin <= MOST_DOTS * width / 1000;
      [xs, ys] = isDots ? [x.slice(begin, end), y.slice(begin, end)] : thinned(x, y, begin, end, width);
      visible = y.subarray(begin, end);
    } else if (times && this.within) {
      const kept = [...times.keys()].filter(i => times[i] >= this.within[0] && times[i] <= this.within[1]);
      const every = Math.ceil(kept.length / MOST_DRAWN_DOTS) || 1;
      const chosen = kept.filter((_, rank) => rank % every === 0);
      [xs, ys] = [chosen.map(i => x[i]), chosen.map(i => y[i])];
    }
    source.data = {x: xs, y: ys};
    [stroke.visible, dots.visible] = [!isDots, isDots];
    return visible;
  }

  // cursor

  point(at) {
    const [begin, end] = this.data.span;
    if (!Number.isFinite(at)) return;
    at = Math.min(Math.max(at, begin), end);
    for (const other of this.group) if (other.hasCursor) other.read(at);
  }

  read(at) {
    this.cursor = at;
    const parts = [];
    for (const {panel, curves, cursor} of this.panels) {
      cursor.setv({location: at, visible: true});
      const unit = (/\[([^\]]*)\]$/.exec(panel.title) ?? ['', ''])[1];
      for (const {curve} of curves) {
        if (!curve.name || !curve.x.length) continue;
        const after = Math.min(firstFrom(curve.x, at), curve.x.length - 1), before = Math.max(after - 1, 0);
        const index = at - curve.x[before] < curve.x[after] - at ? before : after;
        const value = String(Number(curve.y[index].toPrecision(4))).replace('-', '−');
        parts.push(`${curve.name} ${value} ${unit}`);
      }
    }
    const axis = /^(.*?)(?: \[(.*)\])?$/.exec(this.data.axis);
    const digits = Math.max(0, 3 - Math.floor(Math.log10((this.view[1] - this.view[0]) || 1)));
    this.reading.textContent = `${axis[1]} ${at.toFixed(Math.min(digits, 6))} ${axis[2] ?? ''}: ${parts.join(', ')}`;
  }
}

// the page

async function start() {
  if (!window.Bokeh || !window.DecompressionStream || !window.IntersectionObserver) return;
  Bokeh.logger?.set_level?.('error');
  document.documentElement.classList.add('plots');
  const plots = [];
  const observer = new IntersectionObserver(async entries => {
    for (const {isIntersecting, target} of entries) {
      if (!isIntersecting) continue;
      observer.unobserve(target);
      const plot = await Plot.of(target);
      const {clock} = plot.data;
      if (clock) clocks.set(clock, [...(clocks.get(clock) ?? []), plot]);
      plots.push(plot);
    }
  }, {rootMargin: '600px'});
  for (const figure of document.querySelectorAll('figure.chart')) observer.observe(figure);
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => plots.forEach(plot => plot.build()));
}

if (document.readyState === 'loading') document.addEventListener('DOMContentLoaded', start); else start();
})();
