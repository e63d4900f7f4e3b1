/** A plot over time or another axis, by uPlot: shared cursor, zoom by dragging, legend with the values at the cursor, summary and table. */
import { For, Index, Show, createEffect, createMemo, createSignal, createUniqueId, on, onCleanup, onMount, untrack } from "solid-js";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { short } from "../format";
import { colour, dark } from "../theme";
import { rangeOf, tickText } from "./axis";
import { type Values, extent, placeAt, samplePlaces } from "./series";
import type { View } from "./view";

export interface Line {
  label: string;
  values: Values;
  /** Name of a colour variable. */
  colour: string;
  dash?: number[];
  width?: number;
  /** Held from sample to sample instead of joined. */
  step?: boolean;
  /** Dots instead of a line. */
  points?: boolean;
  /** Behind the others and without a legend entry: the samples of a mean. */
  faint?: boolean;
  /** Joined across missing values. */
  joined?: boolean;
}

/** A shaded area between two series. */
export interface Band {
  label: string;
  low: Values;
  high: Values;
  colour: string;
  opacity?: number;
  /** It may extend beyond the plot, whose range is that of the others. */
  beyond?: boolean;
}

interface Props {
  title: string;
  unit: string;
  x: readonly number[];
  xLabel?: string;
  /** x is a count: ticks at integers only. */
  xWhole?: boolean;
  xUnit?: string;
  /** Logarithmic x axis. */
  xLog?: boolean;
  /** Logarithmic y axis. */
  yLog?: boolean;
  /** Labelled intervals of x, such as the frequency of a rotor. */
  marks?: readonly { from: number; to: number; at: number; label: string; colour: string }[];
  lines: readonly Line[];
  bands?: readonly Band[];
  view?: View;
  height?: number;
  /** Horizontal lines, such as a threshold. */
  levels?: readonly { value: number; label: string }[];
}

const TABLE_ROWS = 25;
/** Steps of an arrow key per interval shown. */
const KEY_STEPS = 200;
/** Least interval for zooming, relative to the time: limited by the precision of numbers. */
const FINEST_ZOOM = 1e-12;

export function Chart(props: Props) {
  let holder!: HTMLDivElement;
  const id = createUniqueId();
  const [open, setOpen] = createSignal(false);
  const xLabel = () => props.xLabel ?? "time";
  const xUnit = () => props.xUnit ?? "s";
  const xHead = () => [xLabel(), xUnit()].filter(Boolean).join(", ");
  const unit = () => (props.unit === "1" ? "" : props.unit);

  const structure = createMemo(() =>
    JSON.stringify([
      dark(),
      props.lines.map((line) => [line.label, line.colour, line.dash, line.width, line.step, line.points, line.joined, line.faint]),
      props.bands?.map((band) => [band.label, band.colour, band.opacity, band.beyond]),
      props.height,
      props.unit,
      props.view?.shades?.(),
      props.marks,
    ]),
  );
  const data = createMemo(() => {
    const bands = (props.bands ?? []).flatMap((band) => [band.low, band.high]);
    return [props.x, ...bands, ...props.lines.map((line) => line.values)] as unknown as uPlot.AlignedData;
  });

  onMount(() => {
    let plot: uPlot | undefined;
    let drawn: uPlot.AlignedData;
    const build = () => {
      plot?.destroy();
      drawn = data();
      plot = new uPlot(options(props, xLabel(), xUnit(), Math.max(120, holder.clientWidth)), drawn, holder);
      place(plot, props.view);
    };
    createEffect(on(structure, () => untrack(build)));
    // Invisible plots are drawn on approach: in a live flight ten plots change several times a second, and two are on the screen.
    const [near, setNear] = createSignal(true);
    const watcher = new IntersectionObserver(([entry]) => setNear(entry?.isIntersecting ?? true), { rootMargin: "50% 0px" });
    watcher.observe(holder);
    const onPaper = () => setNear(true);
    window.addEventListener("beforeprint", onPaper);
    createEffect(
      on([data, near], ([next, seen]) => {
        if (!plot || !seen || next === drawn) return;
        drawn = next;
        plot.setData(next, true);
        place(plot, props.view);
      }, { defer: true }),
    );
    createEffect(() => {
      const range = props.view?.range();
      if (plot) untrack(() => scale(plot as uPlot, range));
    });
    createEffect(() => {
      const at = props.view?.cursor();
      if (plot && near()) move(plot, at);
    });
    const observer = new ResizeObserver(() => {
      if (plot && holder.clientWidth > 0 && holder.clientWidth !== plot.width) {
        plot.setSize({ width: holder.clientWidth, height: props.height ?? 190 });
      }
    });
    observer.observe(holder);
    onCleanup(() => {
      observer.disconnect();
      watcher.disconnect();
      window.removeEventListener("beforeprint", onPaper);
      plot?.destroy();
    });
  });

  const onKey = (event: KeyboardEvent) => {
    const view = props.view;
    const [first, last] = [props.x[0], props.x.at(-1)];
    if (!view || first === undefined || last === undefined) return;
    const [from, to] = view.range() ?? [first, last];
    const step = ((to - from) / KEY_STEPS) * (event.shiftKey ? 10 : 1);
    const at = view.cursor() ?? from;
    if (event.key === "ArrowRight") view.setCursor(Math.min(to, at + step));
    else if (event.key === "ArrowLeft") view.setCursor(Math.max(from, at - step));
    else if (event.key === "Escape") view.setRange(undefined);
    else return;
    event.preventDefault();
  };

  const atCursor = (line: Line) => {
    const at = props.view?.cursor();
    if (at === undefined || props.x.length === 0) return "";
    return ` ${short(line.values[placeAt(props.x, at)])}`;
  };
  const spoken = () => props.lines.filter((line) => !line.faint);
  const summary = createMemo(() =>
    spoken()
      .map((line) => {
        const found = extent(line.values);
        return found
          ? `${line.label}: from ${short(found.least)} to ${short(found.largest)} ${unit()}, mean ${short(found.mean)}, last ${short(found.last)}`
          : `${line.label}: no value`;
      })
      .join(". "),
  );

  return (
    <figure class="plot fig" aria-labelledby={`${id}-title`}>
      <div class="legend">
        <strong id={`${id}-title`}>{props.title}{unit() ? `, ${unit()}` : ""}</strong>
        {/* By place: while a flight goes on the lines are others a few times a second, and what is said of them stays. */}
        <Index each={spoken()}>
          {(line) => (
            <span class="key">
              <i class="swatch" style={{ "background-color": `var(--${line().colour})` }} />
              {line().label}
              <span class="num">{atCursor(line())}</span>
            </span>
          )}
        </Index>
        <Index each={props.bands ?? []}>
          {(band) => (
            <span class="key">
              <i class="swatch box" style={{ "background-color": `var(--${band().colour})`, opacity: String(band().opacity ?? 0.25) }} />
              {band().label}
            </span>
          )}
        </Index>
      </div>
      <div
        class="canvas"
        ref={holder}
        tabindex="0"
        role="group"
        aria-label={`${props.title}: arrow keys move the cursor, Escape shows all`}
        aria-describedby={`${id}-sum`}
        onKeyDown={onKey}
      />
      <p class="sr" id={`${id}-sum`}>{summary()}</p>
      <details onToggle={(event) => setOpen(event.currentTarget.open)}>
        <summary>Summary and table<span class="sr"> of {props.title}</span></summary>
        <Show when={open()}>
          <p class="sum">{summary()}</p>
          <Table {...props} lines={spoken()} xHead={xHead()} />
        </Show>
      </details>
    </figure>
  );
}

function Table(props: Props & { xHead: string }) {
  const rows = createMemo(() => samplePlaces(props.x, props.view?.range(), TABLE_ROWS));
  return (
    <div class="scroll" tabindex="0" role="region" aria-label={`Table of ${props.title}`}>
      <table class="small">
        <thead>
          <tr>
            <th class="r" scope="col">{props.xHead}</th>
            <For each={props.lines}>{(line) => <th class="r" scope="col">{line.label}</th>}</For>
          </tr>
        </thead>
        <tbody>
          <For each={rows()}>
            {(place) => (
              <tr>
                <td class="r">{short(props.x[place], 5)}</td>
                <For each={props.lines}>{(line) => <td class="r">{short(line.values[place])}</td>}</For>
              </tr>
            )}
          </For>
        </tbody>
      </table>
    </div>
  );
}

function options(props: Props, xLabel: string, xUnit: string, width: number): uPlot.Options {
  const [text, grid] = [colour("muted"), colour("grid")];
  const font = "11px system-ui, sans-serif";
  const axis = { stroke: text, font, grid: { stroke: grid, width: 1 }, ticks: { stroke: grid, width: 1, size: 4 } };
  const view = props.view;
  const bands = props.bands ?? [];
  const hidden = (auto: boolean): uPlot.Series => ({ stroke: "transparent", width: 0, points: { show: false }, auto });
  const levels = props.levels ?? [];
  return {
    width,
    height: props.height ?? 190,
    legend: { show: false },
    scales: { x: { time: false, ...(props.xLog ? { distr: 3 as const } : {}) }, y: props.yLog ? { distr: 3 as const } : { range: (_, least, largest) => rangeOf(least, largest) } },
    axes: [
      // Time needs no name, only its unit.
      { ...axis, ...(props.xWhole ? { incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000] } : {}), ...(props.xLabel ? { label: [xLabel, xUnit].filter(Boolean).join(", "), labelSize: 17, labelGap: 0, labelFont: font } : {}), size: 34, space: 70, values: (_, splits) => splits.map((split, place) => (split === null ? "" : `${tickText(split)}${!props.xLabel && xUnit && place === splits.length - 1 ? ` ${xUnit}` : ""}`)) },
      { ...axis, size: 62, space: 34, values: (_, splits) => splits.map((split) => (split === null ? "" : tickText(split))) },
    ],
    cursor: {
      drag: { x: true, y: false, setScale: false },
      points: { show: false },
      y: false,
      bind: {
        dblclick: () => () => {
          view?.setRange(undefined);
          return null;
        },
      },
    },
    series: [
      { label: `${xLabel}, ${xUnit}` },
      ...bands.flatMap((band) => [hidden(!band.beyond), hidden(!band.beyond)]),
      ...props.lines.map((line): uPlot.Series => {
        const series: uPlot.Series = {
          label: line.label,
          stroke: line.points ? "transparent" : line.faint ? faded(colour(line.colour), 0.16) : colour(line.colour),
          width: line.width ?? 1.4,
          spanGaps: line.joined ?? false,
          points: line.points ? { show: true, size: 5, stroke: colour(line.colour), fill: colour(line.colour) } : { show: false },
        };
        if (line.dash) series.dash = line.dash;
        if (line.step) {
          const paths = uPlot.paths.stepped?.({ align: 1 });
          if (paths) series.paths = paths;
        }
        return series;
      }),
    ],
    bands: bands.map((band, place) => ({ series: [2 * place + 2, 2 * place + 1], fill: faded(colour(band.colour), band.opacity ?? 0.25) })),
    hooks: {
      setCursor: [
        (plot) => {
          const left = plot.cursor.left ?? -1;
          if (view && left >= 0 && plot.cursor.event) view.setCursor(plot.posToVal(left, "x"));
        },
      ],
      setSelect: [
        (plot) => {
          if (plot.select.width < 4) return;
          const range = [plot.posToVal(plot.select.left, "x"), plot.posToVal(plot.select.left + plot.select.width, "x")] as const;
          plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
          if (view) view.setRange(range);
          else plot.setScale("x", { min: range[0], max: range[1] });
        },
      ],
      drawClear: [
        (plot) => {
          for (const [from, to] of view?.shades?.() ?? []) {
            const [left, right] = [plot.valToPos(from, "x", true), plot.valToPos(to, "x", true)].map((at) => Math.min(plot.bbox.left + plot.bbox.width, Math.max(plot.bbox.left, at)));
            if (left === undefined || right === undefined || right <= left) continue;
            plot.ctx.save();
            plot.ctx.fillStyle = faded(colour("warn"), 0.1);
            plot.ctx.fillRect(left, plot.bbox.top, right - left, plot.bbox.height);
            plot.ctx.restore();
          }
        },
      ],
      draw: [
        (plot) => {
          for (const mark of props.marks ?? []) drawMark(plot, mark);
          for (const level of levels) {
            const y = plot.valToPos(level.value, "y", true);
            if (y < plot.bbox.top || y > plot.bbox.top + plot.bbox.height) continue;
            plot.ctx.save();
            plot.ctx.strokeStyle = colour("bad");
            plot.ctx.setLineDash([4, 4]);
            plot.ctx.beginPath();
            plot.ctx.moveTo(plot.bbox.left, y);
            plot.ctx.lineTo(plot.bbox.left + plot.bbox.width, y);
            plot.ctx.stroke();
            plot.ctx.fillStyle = colour("bad");
            plot.ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
            // The axes leave their own alignment behind.
            plot.ctx.textAlign = "left";
            plot.ctx.textBaseline = "bottom";
            plot.ctx.fillText(level.label, plot.bbox.left + 6, y - 4);
            plot.ctx.restore();
          }
        },
      ],
    },
  };
}

/** An interval across the plot, with a centre line and its name at the top; parts outside the plot are clipped. */
function drawMark(plot: uPlot, mark: NonNullable<Props["marks"]>[number]): void {
  const box = plot.bbox;
  const inside = (at: number) => Math.min(box.left + box.width, Math.max(box.left, at));
  const [left, right, middle] = [mark.from, mark.to, mark.at].map((at) => plot.valToPos(at, "x", true));
  if (left === undefined || right === undefined || middle === undefined || right < box.left || left > box.left + box.width) return;
  const line = colour(mark.colour);
  plot.ctx.save();
  plot.ctx.fillStyle = faded(line, 0.16);
  plot.ctx.fillRect(inside(left), box.top, Math.max(1, inside(right) - inside(left)), box.height);
  if (middle >= box.left && middle <= box.left + box.width) {
    plot.ctx.strokeStyle = line;
    plot.ctx.beginPath();
    plot.ctx.moveTo(middle, box.top);
    plot.ctx.lineTo(middle, box.top + box.height);
    plot.ctx.stroke();
  }
  plot.ctx.restore();
}

const faded = (rgb: string, opacity: number) => rgb.replace(/^rgb\(([^)]*)\)$/, `rgba($1, ${opacity})`);

function place(plot: uPlot, view: View | undefined): void {
  scale(plot, view?.range());
  move(plot, view?.cursor());
}

function scale(plot: uPlot, range: readonly [number, number] | undefined): void {
  const x = plot.data[0] as readonly number[];
  const [min, max] = range ?? [x[0], x.at(-1)];
  if (min !== undefined && max !== undefined && max - min > FINEST_ZOOM * Math.abs(max)) plot.setScale("x", { min, max });
}

function move(plot: uPlot, at: number | undefined): void {
  const left = at === undefined ? -10 : plot.valToPos(at, "x");
  if (Math.abs((plot.cursor.left ?? -10) - left) > 0.5) plot.setCursor({ left, top: 0 }, false);
}
