// Draws the figures of the report from the numbers in #data. One file, no network; uPlot stands above.
(function () {
  'use strict';
  const data = JSON.parse(document.getElementById('data').textContent);
  if (!data.time) return;

  // Little-endian f32 in base64; NaN is a gap.
  function numbers(text) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    const out = new Array(bytes.length / 4);
    for (let i = 0; i < out.length; i++) {
      const value = view.getFloat32(4 * i, true);
      out[i] = Number.isFinite(value) ? value : null;
    }
    return out;
  }

  // ---- theme -------------------------------------------------------------------------------------------------
  const root = document.documentElement;
  const colours = {};
  function readColours() {
    const style = getComputedStyle(root);
    for (const name of ['text', 'muted', 'grid', 'line', 'state', 'reference', 'accent', 'third', 'good', 'warn', 'bad', 'raw', 'setpoint',
      'fault', 'fault-strong', 'fault-text', 'lane', 'idle', 'c1', 'c2', 'c3', 'c4', 'c5', 'c6', 'c7', 'c8']) {
      colours[name] = style.getPropertyValue('--' + name).trim();
    }
  }
  readColours();
  const colour = (name) => () => colours[name];
  const charts = [];
  function repaint() {
    readColours();
    for (const chart of charts) {
      chart.redraw(false, true);
      // Markers of the legend are painted once by uPlot.
      markers(chart);
    }
  }
  function markers(chart) {
    if (!chart.legendBox) return;
    chart.legendBox.querySelectorAll('.u-series').forEach((row, i) => {
      const marker = row.querySelector('.u-marker');
      const series = chart.series[i];
      if (marker && series && series.tint) {
        marker.style.cssText = `border: 0 ${series.dash ? 'dashed' : 'solid'} ${colours[series.tint]}; border-bottom-width: 2px`;
      }
    });
  }
  const darkQuery = matchMedia('(prefers-color-scheme: dark)');
  darkQuery.addEventListener('change', repaint);
  const button = document.getElementById('theme');
  if (button) {
    button.hidden = false;
    button.addEventListener('click', () => {
      const dark = root.dataset.theme ? root.dataset.theme === 'dark' : darkQuery.matches;
      root.dataset.theme = dark ? 'light' : 'dark';
      repaint();
    });
  }
  let themeBefore;
  addEventListener('beforeprint', () => { themeBefore = root.dataset.theme; root.dataset.theme = 'light'; fit(700); repaint(); });
  addEventListener('afterprint', () => {
    if (themeBefore) root.dataset.theme = themeBefore; else delete root.dataset.theme;
    fit(); repaint();
  });

  // ---- shared behaviour of the time plots -----------------------------------------------------------------------
  const font = '11.5px system-ui, -apple-system, "Segoe UI", Roboto, Arial, sans-serif';
  const bold = '600 11.5px system-ui, -apple-system, "Segoe UI", Roboto, Arial, sans-serif';
  let zooming = false;
  function zoomAll(source) {
    if (zooming) return;
    zooming = true;
    const { min, max } = source.scales.x;
    for (const chart of charts) {
      if (chart !== source && chart.isTime) chart.setScale('x', { min, max });
    }
    zooming = false;
  }

  // Shades the intervals with a fault; writes what it is if `named`.
  function faults(named) {
    return {
      drawClear: (u) => {
        const { ctx } = u;
        const { left, top, width, height } = u.bbox;
        ctx.save();
        ctx.beginPath();
        ctx.rect(left, 0, width, top + height);
        ctx.clip();
        let strong = false;
        for (const interval of data.intervals) {
          if (!interval.fault) { strong = false; continue; }
          const a = u.valToPos(interval.start, 'x', true);
          const b = u.valToPos(interval.end, 'x', true);
          ctx.fillStyle = colours[strong ? 'fault-strong' : 'fault'];
          ctx.fillRect(a, top, b - a, height);
          strong = !strong;
          if (named && b - a > 0) {
            const dpr = devicePixelRatio || 1;
            ctx.fillStyle = colours['fault-text'];
            ctx.font = bold.replace('11.5px', 11.5 * dpr + 'px');
            ctx.textBaseline = 'top';
            ctx.textAlign = 'left';
            const from = Math.max(a, left);
            const room = Math.min(b, left + width) - from - 4 * dpr;
            let text = interval.text;
            if (ctx.measureText(text).width > room) text = interval.short;
            if (ctx.measureText(text).width <= room) ctx.fillText(text, from + 1 * dpr, top - 15 * dpr);
          }
        }
        ctx.restore();
      },
    };
  }

  function axis(options) {
    return Object.assign({
      stroke: colour('muted'), font, labelFont: font, labelSize: 18, labelGap: 0, gap: 4,
      grid: { stroke: colour('grid'), width: 1 }, ticks: { show: false },
    }, options);
  }

  // Only the lowest pane of a figure has numbers and a label under it.
  const BARE = 6, LABELLED = 38;
  function timeAxis(last) {
    return last ? axis({ size: 22, labelSize: LABELLED - 22, label: 'time, s' })
      : axis({ size: BARE, values: (u, splits) => splits.map(() => '') });
  }

  function make(holder, options, values) {
    const legendHolder = options.legendHolder;
    const hooks = {
      setScale: [(u, key) => { if (key === 'x' && options.isTime) zoomAll(u); }],
      setCursor: [(u) => { if (u.legendBox) u.legendBox.classList.toggle('live', u.cursor.idx != null && u.cursor.left >= 0); }],
      drawClear: [], draw: [],
    };
    for (const extra of options.hooks || []) for (const key in extra) hooks[key].push(extra[key]);
    const chart = new uPlot({
      width: 600, height: options.height, pxAlign: 0,
      padding: options.padding || [8, 10, 0, 0],
      scales: options.scales, axes: options.axes, series: options.series, hooks,
      legend: {
        show: !!legendHolder, live: true, isolate: false,
        markers: { width: 2 },
        mount: (u, table) => { if (legendHolder) { legendHolder.appendChild(table); u.legendBox = table; } },
      },
      cursor: {
        sync: options.isTime ? { key: 'time', setSeries: false } : undefined,
        drag: { x: !!options.isTime, y: false }, points: { size: 6 }, focus: { prox: -1 },
        x: true, y: false,
      },
    }, values, holder);
    chart.isTime = !!options.isTime;
    chart.holder = holder;
    chart.fixedHeight = options.height;
    charts.push(chart);
    markers(chart);
    return chart;
  }

  // Canvas sizes follow the page.
  function fit(forced) {
    const main = document.querySelector('main');
    const style = getComputedStyle(main);
    const page = main.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
    for (const chart of charts) {
      let width = chart.holder.clientWidth;
      if (typeof forced === 'number') width = Math.floor(width * Math.min(1, forced / page));
      if (width > 40 && width !== chart.width) chart.setSize({ width, height: chart.fixedHeight });
    }
  }

  const value = (digits, unit) => (u, v) => (v == null ? '' : v.toFixed(digits) + (unit ? ' ' + unit : ''));
  const timeSeries = { label: 't', value: value(2, 's') };
  function line(label, tint, digits, unit, options) {
    return Object.assign({
      label, tint, stroke: colour(tint), width: 1.4, points: { show: false }, value: value(digits, unit),
    }, options);
  }
  const dashed = { dash: [7, 7], width: 1.5 };
  const under = { width: 2.4 };

  // ---- Figures 9 to 11 and the duty: full-width panes -----------------------------------------------------------------
  const time = numbers(data.time);
  const wide = data.wide.map(numbers);
  const meanTime = numbers(data.mean_time);
  const duty = data.duty.map(numbers);
  function pane(id, title, unit, series, values, options) {
    const place = document.getElementById(id);
    if (!place) return;
    const box = document.createElement('div');
    box.className = 'pane';
    const bar = document.createElement('div');
    bar.className = 'bar';
    const heading = document.createElement('h3');
    heading.textContent = title;
    bar.appendChild(heading);
    box.appendChild(bar);
    const holder = document.createElement('div');
    box.appendChild(holder);
    place.appendChild(box);
    const last = options.last;
    make(holder, {
      isTime: true, height: (options.height || 118) + (last ? LABELLED - BARE : 0) + (options.named ? 12 : 0), legendHolder: bar,
      padding: [options.named ? 18 : 6, 10, 0, 0],
      scales: { x: { time: false }, y: Object.assign({ range: padded(options.least || 0) }, options.y) },
      axes: [
        timeAxis(last),
        axis({ size: 44, label: unit, labelSize: 15, space: 24 }),
      ],
      series: [timeSeries].concat(series), hooks: [faults(options.named)],
    }, values);
  }
  // Range with 6 % of air; never narrower than `least`, so that noise does not fill a pane.
  function padded(least) {
    return (u, low, high) => {
      if (low == null || high == null) return [0, 1];
      const missing = Math.max(0, least - (high - low)) / 2;
      const air = 0.06 * Math.max(high - low, least, 1e-9);
      return [low - missing - air, high + missing + air];
    };
  }

  // What moves slowly is drawn on top of what it is compared with.
  const reference = (unit) => line('reference', 'reference', 2, unit, dashed);
  ['north', 'east', 'down (negative is up)'].forEach((name, i) => pane('figure-position', name, 'm',
    [line('state', 'state', 2, 'm', under), reference('m')],
    [time, wide[2 * i + 1], wide[2 * i]],
    { least: 0.5, named: i === 0, y: i === 2 ? { dir: -1 } : {} }));
  pane('figure-position', 'error', 'm',
    ['north', 'east', 'down'].map((name, i) => line(name, 'c' + (i + 1), 3, 'm', { width: 1.1 })),
    [time, wide[16], wide[17], wide[18]], { least: 0.02, last: true });
  ['roll', 'pitch', 'yaw'].forEach((name, i) => pane('figure-attitude', name, 'deg',
    i === 2 ? [line('state', 'state', 2, '°', under), reference('°')]
      : [line('setpoint', 'setpoint', 2, '°', { width: 1 }), line('state', 'state', 2, '°')],
    i === 2 ? [time, wide[11], wide[10]] : [time, wide[6 + 2 * i], wide[7 + 2 * i]],
    { least: 1, last: i === 2, named: i === 0 }));
  pane('figure-battery', 'state of charge', '%', [line('state of charge', 'state', 2, '%')], [time, wide[12]],
    { least: 2, named: true });
  pane('figure-battery', 'voltage', 'V',
    [line('open circuit', 'reference', 3, 'V', dashed), line('at the terminals', 'state', 3, 'V')], [time, wide[13], wide[14]],
    { least: 0.2, last: true });
  pane('figure-duty', 'duty cycle', '%', duty.map((_, i) => line('' + (i + 1), 'c' + (i % 8 + 1), 1, '%',
    i >= 8 ? { dash: [4, 3] } : {})), [meanTime].concat(duty), { least: 2, last: true, named: true, height: 190 });

  // ---- Figure 12: residuals as small multiples -------------------------------------------------------------------------------
  (function residuals() {
    const place = document.getElementById('figure-residuals');
    if (!place) return;
    const x = numbers(data.residual_time);
    const raw = data.residuals.map(numbers);
    const mean = data.residual_means.map(numbers);
    const names = ['arm', 'lever', 'yaw'];
    const ranges = names.map((_, c) => {
      let low = Infinity, high = -Infinity;
      for (let i = c; i < raw.length; i += 3) {
        raw[i].forEach((v, k) => {
          if (v == null || x[k] < data.scale_from) return;
          if (v < low) low = v;
          if (v > high) high = v;
        });
      }
      if (!(low <= high)) { low = -1; high = 1; }
      const air = 0.05 * Math.max(high - low, 1e-6);
      return [low - air, high + air];
    });
    const add = (className, text) => {
      const cell = document.createElement('div');
      cell.className = className;
      if (text) cell.innerHTML = text;
      place.appendChild(cell);
      return cell;
    };
    const narrow = matchMedia('(max-width: 720px)').matches;
    add('colhead');
    for (const name of names) add('colhead', name + ' component');
    for (let rotor = 0; rotor < data.rotors; rotor++) {
      for (let c = 0; c < 3; c++) {
        const label = `<i>r</i><sub>${rotor + 1}</sub>`;
        if (narrow) add('rowhead', `${label}<br><small>${names[c]}</small>`);
        else if (c === 0) add('rowhead', label);
        const holder = add('cell');
        const last = rotor === data.rotors - 1;
        const table = uPlot.join([[x, raw[3 * rotor + c]], [meanTime, mean[3 * rotor + c]]]);
        make(holder, {
          isTime: true, height: 82 + (last ? LABELLED - BARE : 0), padding: [4, 6, 2, 0],
          scales: { x: { time: false }, y: { range: () => ranges[c] } },
          axes: [
            timeAxis(last),
            axis({ size: 42, space: 22 }),
          ],
          series: [timeSeries,
            line('residual', 'raw', 4, '', { width: 0.8 }),
            line('mean', 'accent', 4, '', { width: 1.8 })],
          hooks: [faults(false)],
        }, table);
      }
    }
  })();

  // ---- Figure 13: normal plot -----------------------------------------------------------------------------------------------
  (function normal() {
    const place = document.getElementById('figure-normal');
    if (!place || !data.normal) return;
    const z = data.normal.z;
    const probabilities = [0.001, 0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99, 0.999];
    const splits = [-3.0902, -2.3263, -1.6449, -0.6745, 0, 0.6745, 1.6449, 2.3263, 3.0902];
    let low = Infinity, high = -Infinity;
    const panels = data.normal.panels.map((panel) => panel.lines.map((l) => {
      const q = numbers(l.quantiles);
      for (const v of q) if (v != null) { low = Math.min(low, v); high = Math.max(high, v); }
      return { q, reference: l.reference };
    }));
    const air = 0.05 * Math.max(high - low, 1e-9);
    panels.forEach((lines, p) => {
      const box = document.createElement('div');
      box.className = 'pane';
      box.innerHTML = '<div class="bar"><h3></h3></div><div></div>';
      box.querySelector('h3').textContent = data.normal.panels[p].title;
      place.appendChild(box);
      const tints = ['c1', 'c2', 'c3'];
      const series = [{ label: 'z', value: value(2) }];
      const values = [z];
      lines.forEach((l, c) => {
        values.push(z.map((v) => l.reference[0] + v * l.reference[1]));
        series.push({ stroke: colour(tints[c]), width: 1, dash: [5, 4], points: { show: false }, label: '' });
        values.push(l.q);
        series.push(line(['arm', 'lever', 'yaw'][c], tints[c], 4, '', {
          paths: () => null, points: { show: true, size: 3.6, width: 0, fill: colour(tints[c]), stroke: colour(tints[c]) },
        }));
      });
      const chart = make(box.lastChild, {
        height: 300, legendHolder: box.firstChild,
        scales: { x: { time: false, range: () => [-3.6, 3.6] }, y: { range: () => [low - air, high + air] } },
        axes: [
          axis({ size: 22, labelSize: 16, label: 'probability', splits: () => splits, values: () => probabilities }),
          axis({ size: 50, label: data.normal.unit, labelSize: 16 }),
        ],
        series,
      }, values);
      // The reference lines have no place in the legend.
      chart.legendBox.querySelectorAll('.u-series').forEach((row, i) => { if (i % 2 === 1) row.style.display = 'none'; });
    });
  })();

  // ---- Figures 14 and 17: verdicts ----------------------------------------------------------------------------------------------
  (function verdicts() {
    const place = document.getElementById('figure-verdicts');
    if (!place) return;
    const rotors = data.rotors;
    const name = (code) => (code === -2 ? 'not ready' : code === -1 ? 'unknown' : code === 0 ? 'healthy' : 'rotor ' + code);
    const truthTime = [], truth = [];
    for (const interval of data.intervals) { truthTime.push(interval.start); truth.push(interval.label); }
    const labelAt = (t) => {
      let label = 0;
      for (const interval of data.intervals) if (interval.start <= t) label = interval.label;
      return label;
    };
    const present = data.verdicts.filter((v) => !v.absent);
    for (const verdict of data.verdicts) {
      const box = document.createElement('div');
      box.className = 'pane';
      box.innerHTML = '<div class="bar"><h3></h3></div><div></div>';
      box.querySelector('h3').textContent = verdict.title;
      box.firstChild.classList.add('quiet');
      place.appendChild(box);
      if (verdict.absent) {
        box.lastChild.className = 'absent';
        box.lastChild.textContent = verdict.absent;
        continue;
      }
      const last = verdict === present[present.length - 1];
      // [start, end, set of codes]: bit (code + 2)
      const seen = [];
      for (let [start, end, codes] of verdict.seen) {
        // Cut where the truth changes: what was right before may be wrong after.
        for (const cut of truthTime) {
          if (cut <= start || cut >= end) continue;
          seen.push([start, cut, codes]);
          start = cut;
        }
        seen.push([start, end, codes]);
      }
      const times = [...new Set(truthTime.concat(seen.map((s) => s[0]), [data.end]))].sort((a, b) => a - b);
      let at = 0;
      const said = times.map((t) => {
        while (at + 1 < seen.length && seen[at + 1][0] <= t) at++;
        return seen.length ? 31 - Math.clz32(seen[at][2]) - 2 : null;
      });
      const ticks = {
        draw: (u) => {
          const { ctx } = u;
          const { left, top, width, height } = u.bbox;
          const dpr = devicePixelRatio || 1;
          const y = (code) => u.valToPos(code, 'y', true);
          const lane = Math.abs(y(0) - y(1));
          ctx.save();
          ctx.beginPath();
          ctx.rect(left, top, width, height);
          ctx.clip();
          ctx.fillStyle = colours.lane;
          for (const interval of data.intervals) {
            const a = u.valToPos(interval.start, 'x', true), b = u.valToPos(interval.end, 'x', true);
            ctx.fillRect(a, y(interval.label) - 0.46 * lane, b - a, 0.92 * lane);
          }
          const thick = Math.max(3 * dpr, 0.34 * lane);
          for (const [start, end, codes] of seen) {
            const a = u.valToPos(start, 'x', true), b = u.valToPos(end, 'x', true);
            const label = labelAt((start + end) / 2);
            for (let bit = 0; bit < rotors + 3; bit++) {
              if (!(codes >> bit & 1)) continue;
              const code = bit - 2;
              if (code === -2) {
                ctx.fillStyle = colours.idle;
                ctx.fillRect(a, top, b - a, height);
                if (b - a > 80 * dpr) {
                  ctx.fillStyle = colours.muted;
                  ctx.font = bold.replace('11.5px', 11.5 * dpr + 'px');
                  ctx.textAlign = 'center';
                  ctx.textBaseline = 'middle';
                  ctx.fillText('calibrating', (Math.max(a, left) + Math.min(b, left + width)) / 2, y(rotors / 2 + 0.5));
                }
                continue;
              }
              ctx.fillStyle = colours[code === label ? 'good' : code === -1 ? 'warn' : 'bad'];
              const wide = Math.max(b - a, 1.6 * dpr);
              ctx.fillRect(a, y(code) - thick / 2, wide, thick);
            }
          }
          ctx.restore();
        },
      };
      make(box.lastChild, {
        isTime: true, height: 24 + 17 * (rotors + 2) + (last ? LABELLED : BARE), legendHolder: box.firstChild,
        padding: [18, 10, 0, 0],
        scales: { x: { time: false, range: zoomable(data.end) }, y: { range: () => [-1.6, rotors + 0.6] } },
        axes: [
          timeAxis(last),
          axis({
            size: 59, splits: () => Array.from({ length: rotors + 2 }, (_, i) => i - 1),
            values: (u, s) => s.map((v) => (v === -1 ? 'unknown' : v === 0 ? 'healthy' : '' + v)),
          }),
        ],
        series: [timeSeries,
          { label: 'truth', paths: () => null, points: { show: false }, value: (u, v, s, i) => (i == null ? '' : name(labelAt(times[i]))) },
          { label: 'verdict', paths: () => null, points: { show: false }, value: (u, v) => (v == null ? '' : name(v)) }],
        hooks: [faults(true), ticks],
      }, [times, times.map(labelAt), said]);
    }
    const holder = document.getElementById('figure-loss');
    if (holder) {
      pane('figure-loss', 'loss of thrust, as estimated by the sequential detector', 'N',
        [line('estimate', 'state', 3, 'N')], [time, wide[15]], { least: 0.05, last: true, named: false, height: 96 });
    }
  })();
  function zoomable(end) {
    return (u, low, high) => (low == null ? [0, end] : [low, high]);
  }

  fit();
  addEventListener('resize', () => fit());
})();
