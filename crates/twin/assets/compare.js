// Draws heat strip, overlay and plots against conditions of a comparison from the numbers in #data.
(function () {
  'use strict';
  const data = JSON.parse(document.getElementById('data').textContent);

  // Little-endian f32 in base64; NaN is a gap.
  function numbers(text) {
    if (text == null) return null;
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    return Array.from({ length: bytes.length / 4 }, (_, i) => {
      const value = view.getFloat32(4 * i, true);
      return Number.isFinite(value) ? value : null;
    });
  }

  const root = document.documentElement;
  let colours = {};
  const repainters = [];
  function readColours() {
    const style = getComputedStyle(root);
    colours = {};
    for (const name of ['text', 'muted', 'grid', 'line', 'accent', 'third', 'good', 'warn', 'bad', 'raw', 'lane', 'idle', 'panel']) {
      colours[name] = style.getPropertyValue('--' + name).trim();
    }
  }
  readColours();
  const darkQuery = matchMedia('(prefers-color-scheme: dark)');
  function repaint() { readColours(); for (const act of repainters) act(); }
  darkQuery.addEventListener('change', repaint);
  const button = document.getElementById('theme');
  button.hidden = false;
  button.addEventListener('click', () => {
    const dark = root.dataset.theme ? root.dataset.theme === 'dark' : darkQuery.matches;
    root.dataset.theme = dark ? 'light' : 'dark';
    repaint();
  });

  // chi²/N 1 is noise; colour by its logarithm up to 30.
  const STOPS = [[1, [220, 235, 226]], [2, [250, 225, 150]], [5, [240, 165, 80]], [15, [205, 70, 60]], [50, [110, 15, 50]]];
  function heat(value) {
    if (value <= STOPS[0][0]) return `rgb(${STOPS[0][1]})`;
    for (let i = 1; i < STOPS.length; i++) {
      if (value <= STOPS[i][0]) {
        const [a, b] = [STOPS[i - 1], STOPS[i]];
        const share = Math.log(value / a[0]) / Math.log(b[0] / a[0]);
        return `rgb(${a[1].map((x, c) => Math.round(x + share * (b[1][c] - x)))})`;
      }
    }
    return `rgb(${STOPS[STOPS.length - 1][1]})`;
  }
  const short = (value) => {
    if (value == null) return '–';
    const size = Math.abs(value);
    return size >= 1000 ? value.toFixed(0) : size === 0 ? '0' : String(Number(value.toPrecision(3)));
  };
  const font = '11.5px system-ui, -apple-system, "Segoe UI", Roboto, Arial, sans-serif';
  const tints = ['muted', 'accent', 'third', 'good', 'bad'];

  function make(tag, className, text) {
    const element = document.createElement(tag);
    if (className) element.className = className;
    if (text != null) element.textContent = text;
    return element;
  }

  document.querySelectorAll('article[data-log]').forEach((article) => {
    const log = data.logs[Number(article.dataset.log)];
    const time = numbers(log.time);
    const conditions = log.conditions.map((c) => Object.assign({}, c, { values: numbers(c.values) }));
    const measured = log.measured.map(numbers);
    const models = log.models.map((m) => ({
      label: m.label, first: m.first, strips: m.strips,
      channels: m.channels.map((c) => c && { mean: numbers(c.mean), low: numbers(c.low), high: numbers(c.high) }),
    }));
    const find = (selector) => article.querySelector(selector);
    let model = models.length - 1;
    let channel = models[0].first;
    let inside = null;

    const modelSelect = find('select.model');
    models.forEach((m, i) => modelSelect.append(new Option(m.label, i, i === model, i === model)));
    modelSelect.addEventListener('change', () => { model = Number(modelSelect.value); strip(); overlay(true); dependences(); });

    // ---- condition filter ----------------------------------------------------------------------------------
    const [conditionSelect, low, high] = [find('select.condition'), find('input.low'), find('input.high')];
    conditionSelect.append(new Option('no condition', '', true, true));
    conditions.forEach((c, i) => conditionSelect.append(new Option(c.unit ? `${c.title}, ${c.unit}` : c.title, i)));
    function filter() {
      const chosen = conditions[Number(conditionSelect.value)];
      if (conditionSelect.value === '' || !chosen) {
        inside = null;
      } else {
        const from = low.value === '' ? -Infinity : Number(low.value);
        const to = high.value === '' ? Infinity : Number(high.value);
        inside = chosen.values.map((v) => v != null && v >= from && v <= to);
      }
      const count = inside ? inside.filter(Boolean).length : time.length;
      find('.share').textContent = inside ? `${(100 * count / time.length).toFixed(0)} % of the log` : '';
      overlay(true);
      dependences();
    }
    conditionSelect.addEventListener('change', () => {
      const chosen = conditions[Number(conditionSelect.value)];
      if (conditionSelect.value !== '' && chosen) {
        const known = chosen.values.filter((v) => v != null);
        low.value = Math.min(...known).toFixed(2);
        high.value = Math.max(...known).toFixed(2);
      }
      filter();
    });
    low.addEventListener('change', filter);
    high.addEventListener('change', filter);
    find('.clear').addEventListener('click', () => { conditionSelect.value = ''; low.value = high.value = ''; filter(); zoom(null); });

    // ---- heat strip ------------------------------------------------------------------------------------------
    function strip() {
      const holder = find('.strip');
      const rows = models[model].strips;
      const blocks = Math.max(...rows.map((row) => row.length), 1);
      holder.replaceChildren();
      holder.style.gridTemplateColumns = `max-content repeat(${blocks}, minmax(0, 1fr))`;
      rows.forEach((row, c) => {
        holder.append(make('div', c === channel ? 'name chosen' : 'name', data.channels[c]));
        for (let b = 0; b < blocks; b++) {
          const value = row[b];
          const from = log.start + b * log.block;
          const cell = make(value == null ? 'div' : 'button', value == null ? 'cell none' : 'cell');
          if (value != null) {
            cell.type = 'button';
            cell.style.background = heat(value);
            cell.title = `${data.channels[c]}, ${from.toFixed(0)} – ${(from + log.block).toFixed(0)} s: chi²/N ${value.toFixed(2)}`;
            cell.setAttribute('aria-label', cell.title);
            cell.addEventListener('click', () => {
              const moved = channel !== c;
              channel = c;
              strip();
              overlay(false);
              if (moved) dependences();
              zoom([Math.max(log.start, from - log.block), Math.min(log.end, from + 2 * log.block)]);
            });
          } else {
            cell.title = row.length ? 'too little of this block counts' : 'not testable with this log';
          }
          holder.append(cell);
        }
      });
      holder.append(make('div', 'name', 'time, s'));
      for (let b = 0; b < blocks; b++) holder.append(make('div', 'tick', b % 2 ? '' : (log.start + b * log.block).toFixed(0)));
      const scale = find('.scale');
      scale.replaceChildren();
      for (const value of [1, 2, 5, 15, 50]) {
        const item = make('span');
        const patch = make('i');
        patch.style.background = heat(value);
        item.append(patch, value === 1 ? '1 (noise)' : value === 50 ? '50 and more' : String(value));
        scale.append(item);
      }
      const item = make('span');
      const patch = make('i');
      patch.style.background = 'var(--idle)';
      item.append(patch, 'not testable or left out');
      scale.append(item);
    }

    // ---- overlay and residual --------------------------------------------------------------------------------
    let charts = [];
    let zooming = false;
    const width = () => Math.max(320, find('.overlay').clientWidth || article.clientWidth);
    const kept = (values) => (inside ? values.map((v, i) => (inside[i] ? v : null)) : values);
    function zoom(range) {
      for (const chart of charts) chart.setScale('x', range ? { min: range[0], max: range[1] } : { min: log.start, max: log.end });
    }
    function axes(last) {
      const axis = (more) => Object.assign({
        stroke: () => colours.muted, font, labelFont: font, labelSize: 18, labelGap: 0, gap: 4,
        grid: { stroke: () => colours.grid, width: 1 }, ticks: { show: false },
      }, more);
      return [axis(last ? { size: 22, labelSize: 16, label: 'time, s' } : { size: 6, values: (u, s) => s.map(() => '') }),
        axis({ size: 56, label: data.units[channel], values: (u, s) => s.map(short) })];
    }
    function chart(holder, height, last, series, values, bands, extra) {
      const made = new uPlot({
        width: width(), height, scales: { x: { time: false } }, axes: axes(last), series, bands,
        cursor: { sync: { key: 'log' + article.dataset.log, setSeries: false }, drag: { x: true, y: false } },
        legend: { live: true },
        hooks: Object.assign({
          setScale: [(u, key) => {
            if (key !== 'x' || zooming) return;
            zooming = true;
            for (const other of charts) if (other !== u) other.setScale('x', { min: u.scales.x.min, max: u.scales.x.max });
            zooming = false;
          }],
        }, extra),
      }, values, holder);
      // Edges of bands are no series of their own for people.
      made.root.querySelectorAll('.u-legend .u-series').forEach((row, i) => { if (made.series[i].quiet) row.style.display = 'none'; });
      charts.push(made);
      return made;
    }
    function overlay(keepZoom) {
      const range = keepZoom && charts[0] ? [charts[0].scales.x.min, charts[0].scales.x.max] : null;
      for (const made of charts) made.destroy();
      charts = [];
      const [top, bottom] = [find('.overlay'), find('.residual')];
      top.replaceChildren();
      bottom.replaceChildren();
      find('.overlaytitle').textContent = `${data.channels[channel]}: measured and model`;
      const truth = measured[channel];
      if (!truth) { top.append(make('p', 'muted', 'This channel cannot be tested with this log.')); return; }
      const sigma = log.sigma[channel];
      const value = (u, v) => (v == null ? '–' : `${short(v)} ${data.units[channel]}`);
      const line = (label, tint, more) => Object.assign({
        label, stroke: () => colours[tint], width: 1.4, value, points: { show: false }, spanGaps: false,
      }, more);
      const predicted = models.map((m) => (m.channels[channel]
        ? m.channels[channel].mean.map((r, i) => (r == null || truth[i] == null ? null : truth[i] - r)) : truth.map(() => null)));
      const shown = kept(predicted[model]);
      const series = [{ label: 'time', value: (u, v) => (v == null ? '' : v.toFixed(2) + ' s') }];
      const values = [time];
      series.push(line('noise', 'raw', { width: 0, value: () => '± 2 sigma' }), line('', 'raw', { width: 0, quiet: true, value: () => '' }));
      values.push(shown.map((v) => (v == null ? null : v + 2 * sigma)), shown.map((v) => (v == null ? null : v - 2 * sigma)));
      series.push(line('measured', 'text', { width: 1.1 }));
      values.push(kept(truth));
      predicted.forEach((p, i) => {
        series.push(line(models[i].label, tints[1 + (i % 4)], { width: i === model ? 1.7 : 1, dash: i === model ? undefined : [4, 3] }));
        values.push(kept(p));
      });
      const band = [{ series: [1, 2], fill: () => colours.lane }];
      chart(top, 250, false, series, values, band);

      const residual = models[model].channels[channel];
      const flat = (v) => kept(time.map((_, i) => (residual.mean[i] == null ? null : v)));
      const below = [{ label: 'time', value: (u, v) => (v == null ? '' : v.toFixed(2) + ' s') },
        line('samples', 'raw', { width: 0, value: () => 'lowest to highest' }), line('', 'raw', { width: 0, quiet: true, value: () => '' }),
        line('', 'lane', { width: 0, quiet: true, value: () => '' }), line('', 'lane', { width: 0, quiet: true, value: () => '' }),
        line(`residual of ${models[model].label}`, 'bad', { width: 1.3 })];
      const lower = [time, kept(residual.high), kept(residual.low), flat(2 * sigma), flat(-2 * sigma), kept(residual.mean)];
      chart(bottom, 200, true, below, lower,
        [{ series: [1, 2], fill: () => colours.idle }, { series: [3, 4], fill: () => colours.lane }]);
      zoom(range);
    }
    repainters.push(() => { for (const made of charts) made.redraw(false, true); });
    addEventListener('resize', () => { for (const made of charts) made.setSize({ width: width(), height: made.height }); });

    // ---- residual against conditions -------------------------------------------------------------------------
    const BINS = 12;
    function dependences() {
      const holder = find('.conditions');
      holder.replaceChildren();
      find('.conditiontitle').textContent = `Residual of ${data.channels[channel]} against the conditions`;
      if (!models[model].channels[channel]) return;
      const plots = conditions.map((condition) => dependence(condition)).filter(Boolean);
      plots.sort((a, b) => b.explained - a.explained);
      for (const plot of plots) holder.append(plot.element);
    }
    function dependence(condition) {
      const residuals = models.map((m) => m.channels[channel].mean);
      const pairs = [];
      condition.values.forEach((x, i) => {
        if (x != null && residuals[0][i] != null && (!inside || inside[i])) pairs.push([x, i]);
      });
      if (pairs.length < 40) return null;
      const xs = pairs.map((p) => p[0]);
      const [least, most] = [Math.min(...xs), Math.max(...xs)];
      if (!(most - least > 1e-6 * (1 + Math.abs(most)))) return null;
      const sigma = log.sigma[channel];
      const curves = models.map((_, m) => {
        const sums = Array.from({ length: BINS }, () => ({ x: 0, r: 0, n: 0 }));
        for (const [x, i] of pairs) {
          const r = residuals[m][i];
          if (r == null) continue;
          const bin = sums[Math.min(BINS - 1, Math.floor((x - least) / (most - least) * BINS))];
          bin.x += x; bin.r += r; bin.n += 1;
        }
        return sums.filter((s) => s.n >= 5).map((s) => ({ x: s.x / s.n, y: s.r / s.n, band: 1.96 * sigma / Math.sqrt(s.n), n: s.n }));
      });
      const own = curves[model];
      if (own.length < 2) return null;
      const mean = own.reduce((a, b) => a + b.n * b.y, 0) / own.reduce((a, b) => a + b.n, 0);
      const explained = own.reduce((a, b) => a + b.n * (b.y - mean) ** 2, 0);
      const [W, H, L, B, T] = [260, 132, 44, 20, 6];
      const size = Math.max(...curves.flat().map((b) => Math.abs(b.y) + b.band)) * 1.06 || 1;
      const px = (x) => L + (x - least) / (most - least) * (W - L - 8);
      const py = (y) => T + (1 - (y + size) / (2 * size)) * (H - T - B);
      const ns = 'http://www.w3.org/2000/svg';
      const svg = document.createElementNS(ns, 'svg');
      svg.setAttribute('viewBox', `0 0 ${W} ${H}`);
      svg.setAttribute('role', 'img');
      svg.setAttribute('aria-label', `residual of ${data.channels[channel]} against ${condition.title}`);
      const add = (tag, attributes, text) => {
        const element = document.createElementNS(ns, tag);
        for (const key in attributes) element.setAttribute(key, attributes[key]);
        if (text != null) element.textContent = text;
        svg.append(element);
      };
      const label = { 'font-size': 9.5, fill: 'var(--muted)', 'font-family': 'system-ui, sans-serif' };
      add('line', { x1: L, x2: W - 8, y1: py(0), y2: py(0), stroke: 'var(--line)' });
      for (const y of [-size / 1.06, 0, size / 1.06]) {
        add('text', Object.assign({ x: L - 5, y: py(y) + 3, 'text-anchor': 'end' }, label), short(y));
      }
      for (const [x, anchor] of [[least, 'start'], [(least + most) / 2, 'middle'], [most, 'end']]) {
        add('text', Object.assign({ x: px(x), y: H - 6, 'text-anchor': anchor }, label), short(x));
      }
      const path = (points) => points.map((p, i) => `${i ? 'L' : 'M'}${p[0].toFixed(1)} ${p[1].toFixed(1)}`).join('');
      const ribbon = own.map((b) => [px(b.x), py(b.band)]).concat(own.slice().reverse().map((b) => [px(b.x), py(-b.band)]));
      add('path', { d: path(ribbon) + 'Z', fill: 'var(--lane)' });
      curves.forEach((curve, m) => {
        const tint = m === model ? 'var(--bad)' : `var(--${tints[1 + (m % 4)]})`;
        add('path', { d: path(curve.map((b) => [px(b.x), py(b.y)])), fill: 'none', stroke: tint, 'stroke-width': m === model ? 1.6 : 1, 'stroke-dasharray': m === model ? 'none' : '3 3' });
        if (m === model) for (const b of curve) add('circle', { cx: px(b.x), cy: py(b.y), r: 2.4, fill: tint });
      });
      const element = make('figure');
      element.style.margin = '0';
      element.append(make('h3', '', `${condition.title}${condition.unit ? ', ' + condition.unit : ''}`), svg);
      return { element, explained };
    }

    strip();
    overlay(false);
    dependences();
  });
})();
