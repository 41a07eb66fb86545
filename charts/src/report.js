// Charts that zoom, read values and hide curves. Draws anew what `chart.rs` has drawn: without this script the page shows the same
// charts, static. The axes are those of axis.js. Nothing is loaded.
(() => {
  const page = JSON.parse(document.getElementById('data').textContent);
  const columns = page.columns;
  const PRINT = 820, LEFT = 62, RIGHT = 18, TOP = 10, BOTTOM = 26, LINE = 14, LETTER = 6.4, MOST_LINES = 8;
  const hidden = new Set(), groups = new Map(), charts = [];
  let printing = false;

  const escape = text => String(text).replace(/[&<>"]/g, c => ({ '&': '&amp;', '<': '&lt;', '>': '&gt;', '"': '&quot;' })[c]);
  const make = (parent, tag, attributes = {}, text = '') => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    element.textContent = text;
    parent.append(element);
    return element;
  };
  const numberOf = (column, value) => {
    if (value === null || value === undefined) return '–';
    const digits = columns[column].digits;
    return digits === null ? String(+value.toPrecision(6)) : value.toFixed(digits);
  };
  const x = series => columns[series.x].values;
  const y = series => columns[series.y].values;
  const upper = series => columns[series.upper].values;

  // Index of the last value that is not above `wanted`; -1 if there is none.
  const before = (values, wanted) => {
    let [low, high] = [0, values.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] <= wanted) low = middle + 1; else high = middle;
    }
    return low - 1;
  };
  const nearest = (values, wanted) => {
    const at = before(values, wanted);
    if (at < 0) return 0;
    return at + 1 < values.length && values[at + 1] - wanted < wanted - values[at] ? at + 1 : at;
  };

  const shown = chart => chart.series.filter((series, i) => !hidden.has(chart.keys[i]));
  const fullX = chart => {
    const { lo, hi } = chart.group;
    return chart.group.view || [lo, hi];
  };
  const rangeX = charts => {
    const all = charts.flatMap(chart => chart.series);
    const margin = all.some(series => series.kind === 'points') ? 0.04 : 0;
    return axes.range(all.flatMap(x), charts.some(chart => chart.x.log), 0, margin);
  };
  // Over what is visible.
  const rangeY = (chart, [a, b]) => {
    if (chart.lanes.length) return [0, chart.lanes.length];
    if (chart.viewY) return chart.viewY;
    const values = chart.levels.map(level => level.value);
    for (const series of shown(chart)) {
      const [xs, ys] = [x(series), y(series)];
      for (let i = 0; i < xs.length; i++) if (xs[i] >= a && xs[i] <= b) {
        values.push(ys[i]);
        if (series.upper !== undefined) values.push(upper(series)[i]);
      }
    }
    return axes.range(values, chart.log, chart.span, 0.05);
  };

  // Lines interrupted where a value is missing. Of several values in one pixel the smallest and the largest are drawn, in order.
  const line = (series, ax, ay) => {
    const [xs, ys] = [x(series), y(series)];
    const from = Math.max(before(xs, ax.min) - 1, 0), to = Math.min(before(xs, ax.max) + 2, xs.length);
    const dense = to - from > 3 * Math.abs(ax.to - ax.from);
    let path = '', down = false, low = -1, high = -1, pixel = null;
    const put = i => {
      const value = ys[i];
      if (!ax.has(xs[i]) || !ay.has(value)) { down = false; return; }
      path += `${down ? 'L' : 'M'}${ax.at(xs[i]).toFixed(1)} ${ay.at(value).toFixed(1)}`;
      down = true;
    };
    const flush = () => {
      if (low < 0) return;
      put(Math.min(low, high));
      if (low !== high) put(Math.max(low, high));
      low = high = -1;
    };
    for (let i = from; i < to; i++) {
      if (!dense) { put(i); continue; }
      if (!ay.has(ys[i])) { flush(); down = false; continue; }
      const at = Math.floor(ax.at(xs[i]));
      if (at !== pixel) { flush(); pixel = at; }
      if (low < 0 || ys[i] < ys[low]) low = i;
      if (high < 0 || ys[i] > ys[high]) high = i;
    }
    flush();
    return path;
  };
  const band = (series, ax, ay) => {
    const [xs, lo, hi] = [x(series), y(series), upper(series)];
    const back = [];
    let path = '';
    for (let i = 0; i < xs.length; i++) {
      if (!ax.has(xs[i]) || !ay.has(lo[i]) || !ay.has(hi[i])) continue;
      path += `${path ? 'L' : 'M'}${ax.at(xs[i]).toFixed(1)} ${ay.at(lo[i]).toFixed(1)}`;
      back.push(`L${ax.at(xs[i]).toFixed(1)} ${ay.at(hi[i]).toFixed(1)}`);
    }
    return path ? path + back.reverse().join('') + 'Z' : '';
  };
  const points = (series, ax, ay) => {
    const [xs, ys] = [x(series), y(series)];
    let path = '';
    for (let i = 0; i < xs.length; i++) {
      if (!ax.has(xs[i]) || !ay.has(ys[i])) continue;
      path += `M${ax.at(xs[i]).toFixed(1)} ${ay.at(ys[i]).toFixed(1)}h0`;
    }
    return path;
  };
  const DRAW = { line, band, points };

  // Half a unit beyond its ends is the rounding of a mark at one of them.
  const isInside = (mark, ax) => ax.has(mark.x) && ax.at(mark.x) >= ax.from - 0.5 && ax.at(mark.x) <= ax.to + 0.5;
  // The first line of labels in which each mark has room; none beyond MOST_LINES.
  const place = (marks, ax, width) => {
    const ends = [];
    return marks.map(mark => {
      const at = ax.at(mark.x);
      if (!isInside(mark, ax)) return null;
      const room = LETTER * mark.label.length + 12;
      const left = at + room > width;
      const begin = left ? at - room : at;
      let row = ends.findIndex(end => end <= begin);
      if (row < 0) row = ends.length;
      if (row >= MOST_LINES || begin < 0) return null;
      ends[row] = begin + room;
      return { row, left };
    });
  };

  const draw = chart => {
    const { svg } = chart;
    const width = printing ? PRINT : Math.max(svg.clientWidth || chart.figure.clientWidth, 260);
    const height = width < 560 ? Math.max(chart.height * 0.85, 130) : chart.height;
    svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
    const left = width < 560 ? 46 : LEFT;
    const [a, b] = fullX(chart);
    const ax = axes.axis(a, b, left, width - RIGHT, chart.x.log);
    const labels = chart.labeled ? place(chart.marks, ax, width) : [];
    const rows = Math.max(0, ...labels.filter(label => label).map(label => label.row + 1));
    const [lo, hi] = rangeY(chart, [a, b]);
    const unit = chart.x.unit;
    // A name of the axis, longer than a unit, has a line of its own.
    const named = unit.length > 4;
    const ay = axes.axis(lo, hi, height - BOTTOM - (named ? LINE + 2 : 0), TOP + LINE * rows, chart.log);
    chart.ax = ax;
    chart.ay = ay;
    const [bottom, top, right] = [ay.from, ay.to, ax.to];
    let out = `<clipPath id="${chart.id}"><rect x="${left}" y="${top - 1}" width="${right - left}" height="${bottom - top + 2}"/></clipPath>`;
    for (const [value, label] of axes.ticks(ax, (right - left) / 84)) {
      const at = ax.at(value).toFixed(1);
      out += `<line class="grid" x1="${at}" y1="${bottom}" x2="${at}" y2="${top}"/>`;
      if (named || ax.at(value) < right - LETTER * unit.length - 14)
        out += `<text class="tick" text-anchor="middle" x="${at}" y="${bottom + 17}">${label}</text>`;
    }
    out += `<text class="tick" text-anchor="end" x="${right}" y="${bottom + (named ? 33 : 17)}">${escape(unit)}</text>`;
    if (chart.lanes.length) {
      chart.lanes.forEach((name, lane) => { out += yTick(ay.at(lane + 0.1), left, right, escape(name), false); });
    } else {
      for (const [value, label] of axes.ticks(ay, (bottom - top) / 28)) out += yTick(ay.at(value), left, right, label, value === 0);
    }
    for (const level of chart.levels) {
      if (!ay.has(level.value) || level.value < lo || level.value > hi) continue;
      const at = ay.at(level.value).toFixed(1);
      out += `<line class="mark ${level.class}" x1="${left}" y1="${at}" x2="${right}" y2="${at}"/>`;
      if (level.label) out += `<text class="label ${level.class}" text-anchor="end" x="${right - 6}" y="${at - 5}">${escape(level.label)}</text>`;
    }
    out += `<path class="frame" d="M${left} ${top}V${bottom}H${right}"/>`;
    chart.marks.forEach((mark, i) => {
      const at = ax.at(mark.x);
      if (!isInside(mark, ax)) return;
      const label = labels[i];
      const from = label ? TOP + LINE * label.row : top;
      if (label)
        out += `<text class="label ${mark.class}" text-anchor="${label.left ? 'end' : 'start'}" x="${(at + (label.left ? -4 : 4)).toFixed(1)}" y="${from + 10}">${escape(mark.label)}</text>`;
      out += `<line class="mark ${mark.class}" x1="${at.toFixed(1)}" y1="${from}" x2="${at.toFixed(1)}" y2="${bottom}"><title>${escape(mark.label)}</title></line>`;
    });
    out += `<g clip-path="url(#${chart.id})">`;
    chart.series.forEach((series, i) => {
      if (!hidden.has(chart.keys[i])) out += `<path class="${series.kind} ${series.class}" d="${DRAW[series.kind](series, ax, ay)}"/>`;
    });
    svg.innerHTML = out + '</g><g class="cursor"></g>';
    chart.cursor = svg.lastChild;
    showCursor(chart);
  };
  const yTick = (at, left, right, label, zero) =>
    `<line class="grid${zero ? ' zero' : ''}" x1="${left}" y1="${at.toFixed(1)}" x2="${right}" y2="${at.toFixed(1)}"/>` +
    `<text class="tick" text-anchor="end" x="${left - 7}" y="${(at + 4).toFixed(1)}">${label}</text>`;

  // The values at the cursor, in the legend: those of the nearest row of each curve.
  const showCursor = chart => {
    const at = chart.group.at;
    const { ax, ay } = chart;
    let out = '';
    const isVisible = at !== null && at >= ax.min && at <= ax.max && !printing;
    if (isVisible && !chart.isScatter) {
      const place = ax.at(at).toFixed(1);
      out = `<line x1="${place}" y1="${ay.to}" x2="${place}" y2="${ay.from}"/>`;
    }
    chart.series.forEach((series, i) => {
      const output = chart.outputs[i];
      if (!output || chart.isScatter) return;
      const xs = x(series);
      if (!isVisible || !xs.length || at < xs[0] || at > xs[xs.length - 1]) {
        output.textContent = isVisible ? '–' : '';
        return;
      }
      const row = nearest(xs, at);
      const value = y(series)[row];
      output.textContent = chart.lanes.length ? value === null ? '–' : String(Math.round(value % 1))
        : series.upper === undefined ? numberOf(series.y, value)
        : `${numberOf(series.y, value)} to ${numberOf(series.upper, upper(series)[row])}`;
      if (series.kind === 'line' && !hidden.has(chart.keys[i]) && ax.has(xs[row]) && ay.has(value))
        out += `<circle class="${series.class}" cx="${ax.at(xs[row]).toFixed(1)}" cy="${ay.at(value).toFixed(1)}" r="3.5"/>`;
    });
    if (chart.time) chart.time.textContent = isVisible && !chart.isScatter ? `${+at.toPrecision(7)} ${chart.x.unit}` : '';
    chart.cursor.innerHTML = out;
  };
  const moveCursor = (group, at) => {
    if (group.at === at) return;
    group.at = at;
    group.charts.forEach(showCursor);
  };
  const redraw = group => { group.charts.forEach(draw); tools(group); };
  const zoom = (group, a, b) => {
    const log = group.charts.some(chart => chart.x.log);
    const least = group.least;
    if (log) {
      [a, b] = [Math.max(a, group.lo), Math.min(b, group.hi)];
      if (Math.log(b / a) < 0.02) return;
    } else {
      if (b - a < least) { const middle = (a + b) / 2; [a, b] = [middle - least / 2, middle + least / 2]; }
      const span = Math.min(b - a, group.hi - group.lo);
      a = Math.min(Math.max(a, group.lo), group.hi - span);
      b = a + span;
    }
    group.view = a <= group.lo && b >= group.hi ? null : [a, b];
    redraw(group);
  };
  const zoomAt = (chart, factor, place) => {
    const { group, ax } = chart;
    const [a, b] = fullX(chart);
    const of = value => chart.x.log ? Math.log(value) : value;
    const back = value => chart.x.log ? Math.exp(value) : value;
    const at = of(ax.value(place));
    zoom(group, back(at - (at - of(a)) * factor), back(at + (of(b) - at) * factor));
  };
  const reset = group => {
    group.view = null;
    group.charts.forEach(chart => { chart.viewY = null; });
    redraw(group);
  };
  const tools = group => {
    const zoomed = group.view !== null || group.charts.some(chart => chart.viewY);
    group.charts.forEach(chart => { chart.reset.hidden = !zoomed; });
  };

  // The nearest point of a scatter, in pixels, within 24 of them.
  const hit = (chart, px, py) => {
    let best = null, least = 24 * 24;
    chart.series.forEach((series, i) => {
      if (hidden.has(chart.keys[i]) || series.kind !== 'points') return;
      const [xs, ys] = [x(series), y(series)];
      for (let row = 0; row < xs.length; row++) {
        if (!chart.ax.has(xs[row]) || !chart.ay.has(ys[row])) continue;
        const d = (chart.ax.at(xs[row]) - px) ** 2 + (chart.ay.at(ys[row]) - py) ** 2;
        if (d < least) { least = d; best = { series, row }; }
      }
    });
    return best;
  };
  const showPoint = (chart, found) => {
    if (!found) { chart.cursor.innerHTML = ''; chart.time.textContent = ''; return; }
    const { series, row } = found;
    const [vx, vy] = [x(series)[row], y(series)[row]];
    chart.cursor.innerHTML = `<circle class="ring" cx="${chart.ax.at(vx).toFixed(1)}" cy="${chart.ay.at(vy).toFixed(1)}" r="6"/>`;
    const names = series.labels && series.labels.length ? series.labels[row] : series.name;
    chart.time.textContent = `${numberOf(series.x, vx)} ${chart.x.unit}, ${numberOf(series.y, vy)} ${chart.unit}: ${names}`;
  };

  const listen = chart => {
    const { svg, group } = chart;
    const pointers = new Map();
    let begin = null, pinch = null;
    const where = event => {
      const box = svg.getBoundingClientRect();
      const scale = svg.viewBox.baseVal.width / box.width;
      return [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
    };
    const inside = px => Math.min(Math.max(px, chart.ax.from), chart.ax.to);
    const point = (px, py) => {
      if (chart.isScatter) { showPoint(chart, hit(chart, px, py)); return; }
      const first = shown(chart).find(series => x(series).length);
      const wanted = chart.ax.value(inside(px));
      moveCursor(group, first ? x(first)[nearest(x(first), wanted)] : wanted);
    };
    const select = (px, py) => {
      const [from, to] = [Math.min(begin[0], px), Math.max(begin[0], px)];
      const [up, down] = chart.isScatter ? [Math.min(begin[1], py), Math.max(begin[1], py)] : [chart.ay.to, chart.ay.from];
      chart.cursor.innerHTML = `<rect class="select" x="${from}" y="${up}" width="${to - from}" height="${Math.max(down - up, 1)}"/>`;
    };
    svg.addEventListener('pointerdown', event => {
      const at = where(event);
      pointers.set(event.pointerId, at);
      if (pointers.size === 2) {
        const [a, b] = [...pointers.values()].map(([px]) => px);
        pinch = { a: chart.ax.value(a), b: chart.ax.value(b) };
        begin = null;
      } else if (event.pointerType !== 'touch' && event.button === 0) {
        begin = at;
        begin.pan = event.shiftKey ? fullX(chart) : null;
        svg.setPointerCapture(event.pointerId);
      }
      point(...at);
    });
    svg.addEventListener('pointermove', event => {
      const at = where(event);
      if (pointers.has(event.pointerId)) pointers.set(event.pointerId, at);
      if (pinch && pointers.size === 2) {
        const [pa, pb] = [...pointers.values()].map(([px]) => px);
        if (Math.abs(pb - pa) < 8 || chart.x.log) return;
        const scale = (pinch.b - pinch.a) / (pb - pa);
        const from = pinch.a - (pa - chart.ax.from) * scale;
        zoom(group, from, from + Math.abs(scale) * (chart.ax.to - chart.ax.from));
      } else if (begin && begin.pan) {
        const per = (begin.pan[1] - begin.pan[0]) / (chart.ax.to - chart.ax.from);
        const by = (begin[0] - at[0]) * per;
        if (!chart.x.log) zoom(group, begin.pan[0] + by, begin.pan[1] + by);
      } else if (begin && Math.abs(at[0] - begin[0]) > 4) {
        select(inside(at[0]), at[1]);
      } else {
        point(...at);
      }
    });
    const end = event => {
      pointers.delete(event.pointerId);
      if (pointers.size < 2) pinch = null;
      if (begin && !begin.pan && event.type === 'pointerup') {
        const at = where(event);
        const [a, b] = [chart.ax.value(inside(begin[0])), chart.ax.value(inside(at[0]))];
        if (Math.abs(at[0] - begin[0]) > 4) {
          if (chart.isScatter && Math.abs(at[1] - begin[1]) > 4) {
            const values = [begin[1], at[1]].map(py => chart.ay.value(Math.min(Math.max(py, chart.ay.to), chart.ay.from)));
            const [lo, hi] = [Math.min(...values), Math.max(...values)];
            // Zoomed again and again, a range would end as one number, which has no axis.
            if (!axes.isFlat(hi - lo, Math.max(Math.abs(lo), Math.abs(hi)))) chart.viewY = [lo, hi];
          }
          zoom(group, Math.min(a, b), Math.max(a, b));
        }
      }
      begin = null;
    };
    svg.addEventListener('pointerup', end);
    svg.addEventListener('pointercancel', end);
    svg.addEventListener('pointerleave', event => {
      if (event.pointerType === 'touch' || begin) return;
      if (chart.isScatter) showPoint(chart, null); else moveCursor(group, null);
    });
    svg.addEventListener('dblclick', () => reset(group));
    svg.addEventListener('wheel', event => {
      // A page that is scrolled past a chart goes on scrolling: only a chart that was clicked takes the wheel, or one with Ctrl.
      if (!event.ctrlKey && document.activeElement !== svg) return;
      if (event.deltaY > 0 && !group.view) return;
      event.preventDefault();
      zoomAt(chart, Math.exp(Math.max(-100, Math.min(100, event.deltaY)) * 0.0025), inside(where(event)[0]));
    }, { passive: false });
    svg.addEventListener('keydown', event => {
      const middle = () => group.at !== null ? inside(chart.ax.at(group.at)) : (chart.ax.from + chart.ax.to) / 2;
      const step = by => {
        const first = shown(chart).find(series => x(series).length);
        if (!first || chart.isScatter) return;
        const xs = x(first);
        const at = group.at === null ? before(xs, fullX(chart)[0]) + (by > 0 ? 0 : 1) : nearest(xs, group.at);
        moveCursor(group, xs[Math.min(Math.max(at + by, 0), xs.length - 1)]);
      };
      const keys = {
        ArrowLeft: () => step(event.shiftKey ? -10 : -1), ArrowRight: () => step(event.shiftKey ? 10 : 1),
        '+': () => zoomAt(chart, 0.7, middle()), '=': () => zoomAt(chart, 0.7, middle()), '-': () => zoomAt(chart, 1 / 0.7, middle()),
        0: () => reset(group), Escape: () => { reset(group); svg.blur(); },
      };
      if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
    });
  };

  // Title, values and a switch for each curve, in place of the static legend inside the picture.
  const head = chart => {
    const top = document.createElement('figcaption');
    const title = make(top, 'div', { class: 'chart-title' });
    make(title, 'b', {}, chart.title);
    chart.unitText = make(title, 'span', { class: 'unit' }, chart.unit);
    chart.time = make(title, 'output', { class: 'at' });
    chart.reset = make(title, 'button', { type: 'button', class: 'reset', hidden: '' }, 'Whole range');
    chart.reset.addEventListener('click', () => reset(chart.group));
    chart.legend = make(top, 'div', { class: 'legend', role: 'group', 'aria-label': `Curves of ${chart.title}` });
    chart.figure.prepend(top);
    legend(chart);
  };
  const legend = chart => {
    chart.legend.replaceChildren();
    chart.outputs = chart.series.map((series, i) => {
      const key = chart.keys[i];
      const button = make(chart.legend, 'button', { type: 'button', 'aria-pressed': String(!hidden.has(key)), 'data-key': key });
      const swatch = make(button, 'span', { class: 'swatch' });
      swatch.innerHTML = series.kind === 'line' ? `<svg viewBox="0 0 24 8" aria-hidden="true"><path class="line ${series.class}" d="M1 4H23"/></svg>`
        : series.kind === 'band' ? `<svg viewBox="0 0 24 8" aria-hidden="true"><path class="band ${series.class}" d="M1 0H23V8H1Z"/></svg>`
          : `<svg viewBox="0 0 24 8" aria-hidden="true"><path class="points ${series.class}" d="M12 4h0"/></svg>`;
      make(button, 'span', {}, series.name);
      const output = make(button, 'output');
      button.addEventListener('click', () => {
        if (hidden.has(key)) hidden.delete(key); else hidden.add(key);
        charts.filter(other => other.keys.includes(key)).forEach(other => {
          other.legend.querySelectorAll('button').forEach(b => b.setAttribute('aria-pressed', String(!hidden.has(b.dataset.key))));
          draw(other);
        });
      });
      return output;
    });
  };

  // Two columns of a table against each other: quantiles over a few values or intervals, and the rows that no other one beats in both.
  const quantile = (sorted, share) => {
    const at = share * (sorted.length - 1), low = Math.floor(at);
    return sorted[low] + (sorted[Math.min(low + 1, sorted.length - 1)] - sorted[low]) * (at - low);
  };
  const column = (values, digits = null) => columns.push({ digits, values }) - 1;
  const explore = chart => {
    const { fields, run, marked } = chart.explore;
    const [fx, fy] = [fields[chart.explore.x], fields[chart.explore.y]];
    columns.length = chart.columns;
    const rows = [];
    for (let row = 0; row < columns[fx.column].values.length; row++)
      if (columns[fx.column].values[row] !== null && columns[fy.column].values[row] !== null) rows.push(row);
    const vx = rows.map(row => columns[fx.column].values[row]), vy = rows.map(row => columns[fy.column].values[row]);
    const digits = field => columns[field.column].digits;
    const parameters = fields.filter(field => field.axis && field.column !== run);
    const name = row => [...(run === null ? [] : [`run ${columns[run].values[row]}`]),
      ...parameters.map(field => `${field.name}=${columns[field.column].values[row]}`)].join(' ');
    const series = [];
    const steps = [...new Set(vx)].sort((a, b) => a - b);
    if (fx.axis && rows.length > 7 && steps.length > 1) {
      const bins = new Map();
      const [lo, hi] = [steps[0], steps[steps.length - 1]];
      const few = steps.length <= 24;
      vx.forEach((value, i) => {
        const bin = few ? value : Math.min(Math.floor((value - lo) / (hi - lo) * 12), 11);
        if (!bins.has(bin)) bins.set(bin, []);
        bins.get(bin).push(vy[i]);
      });
      const order = [...bins.keys()].sort((a, b) => a - b);
      const places = order.map(bin => few ? bin : lo + (bin + 0.5) * (hi - lo) / 12);
      const sorted = order.map(bin => bins.get(bin).sort((a, b) => a - b));
      const of = share => column(sorted.map(values => quantile(values, share)));
      const xs = column(places);
      series.push({ name: 'min to max', class: 'c1 faint', kind: 'band', x: xs, y: of(0), upper: of(1) });
      series.push({ name: 'quartiles', class: 'c1', kind: 'band', x: xs, y: of(0.25), upper: of(0.75) });
      series.push({ name: 'median', class: 'c1', kind: 'line', x: xs, y: of(0.5) });
    }
    series.push({ name: 'runs', class: 'c4 small', kind: 'points', x: column(vx, digits(fx)), y: column(vy, digits(fy)), labels: rows.map(name) });
    if (!fx.axis && !fy.axis) {
      const order = rows.map((_, i) => i).sort((a, b) => vx[a] - vx[b] || vy[a] - vy[b]);
      let least = Infinity;
      const front = order.filter(i => vy[i] < least && ((least = vy[i]), true));
      const [xs, ys] = [column(front.map(i => vx[i]), digits(fx)), column(front.map(i => vy[i]), digits(fy))];
      series.push({ name: 'Pareto front', class: 'c2', kind: 'line', x: xs, y: ys });
      series.push({ name: `${front.length} on it`, class: 'c2', kind: 'points', x: xs, y: ys, labels: front.map(i => name(rows[i])) });
    }
    for (const mark of marked || []) {
      const i = rows.indexOf(mark.row);
      if (i >= 0) series.push({ name: mark.name, class: mark.class, kind: 'points', x: column([vx[i]], digits(fx)), y: column([vy[i]], digits(fy)), labels: [name(mark.row)] });
    }
    Object.assign(chart, { series, unit: fy.unit, keys: series.map(one => `${chart.id}:${one.name}`), viewY: null });
    chart.x.unit = fx.unit ? `${fx.name} (${fx.unit})` : fx.name;
    chart.title = `${fy.name} against ${fx.name}`;
    chart.log = false;
  };
  const chooser = chart => {
    const bar = make(chart.figure, 'div', { class: 'choose' });
    for (const axis of ['y', 'x']) {
      const label = make(bar, 'label', {}, axis === 'y' ? 'Up: ' : 'Across: ');
      const select = make(label, 'select', { 'data-axis': axis });
      chart.explore.fields.forEach((field, i) => make(select, 'option', { value: i }, field.name));
      select.value = chart.explore[axis];
      select.addEventListener('change', () => {
        chart.explore[axis] = +select.value;
        explore(chart);
        Object.assign(chart.group, { view: null, at: null });
        [chart.group.lo, chart.group.hi] = rangeX([chart]);
        chart.figure.querySelector('.chart-title b').textContent = chart.title;
        chart.unitText.textContent = chart.unit;
        legend(chart);
        redraw(chart.group);
      });
    }
    chart.figure.prepend(bar);
  };

  page.charts.forEach((spec, index) => {
    const figure = document.querySelector(`figure[data-chart="${index}"]`);
    const chart = { ...spec, id: `chart-${index}`, figure, svg: figure.querySelector('svg'), viewY: null, outputs: [] };
    chart.columns = columns.length;
    if (chart.explore) explore(chart);
    chart.keys = chart.series.map((series, i) => series.key || `${chart.id}:${series.name || i}`);
    chart.isScatter = chart.series.some(series => series.kind === 'points');
    // Charts share an axis only if it is of the same kind: a time and a frequency have no common range.
    const name = chart.x.group ? [chart.x.group, chart.x.unit, chart.x.log].join('|') : chart.id;
    if (!groups.has(name)) groups.set(name, { charts: [], view: null, at: null });
    chart.group = groups.get(name);
    chart.group.charts.push(chart);
    chart.svg.setAttribute('tabindex', '0');
    chart.svg.setAttribute('role', 'application');
    chart.svg.setAttribute('aria-label', `${chart.title}: arrow keys move the cursor, plus and minus zoom, 0 resets`);
    charts.push(chart);
  });
  for (const group of groups.values()) {
    [group.lo, group.hi] = rangeX(group.charts);
    const longest = Math.max(...group.charts.flatMap(chart => chart.series.map(series => x(series).length)));
    group.least = (group.hi - group.lo) / Math.max(longest, 100) * 4;
  }
  document.documentElement.classList.add('live');
  charts.forEach(chart => { head(chart); if (chart.explore) chooser(chart); listen(chart); });
  charts.forEach(draw);
  const all = value => { printing = value; charts.forEach(draw); };
  addEventListener('beforeprint', () => all(true));
  addEventListener('afterprint', () => all(false));
  let width = innerWidth;
  addEventListener('resize', () => { if (innerWidth !== width) { width = innerWidth; charts.forEach(draw); } });
})();
