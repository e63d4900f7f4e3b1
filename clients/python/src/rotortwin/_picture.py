"""Pictures of results for notebooks: SVG of a few kilobytes, drawn without a plotting library.

Text takes the colour of the page, so that a picture can be read on dark pages, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Distinguishable with every kind of colour blindness (Okabe and Ito).
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c8c8c", "#f0e442")
_WIDTH = 640
#: Room for the words left of an axis.
_LEFT = 150
_RIGHT = 16
#: Stretches of time of which the lowest and the highest value are drawn.
_STRETCHES = 300


@dataclass(frozen=True)
class Lines:
    """Values over time, on an axis of their own."""

    label: str
    #: Name and values by line; a value that is no number interrupts it.
    series: Sequence[tuple[str, ArrayLike]]


def _svg(height: float, words: str, parts: list[str]) -> str:
    style = 'font-family="sans-serif" font-size="12" fill="currentColor"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{_WIDTH}" height="{height:.0f}" viewBox="0 0 {_WIDTH} {height:.0f}" role="img" {style}>'
    return f"{head}<title>{escape(words)}</title>{''.join(parts)}</svg>"


def _text(x: float, y: float, words: str, anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(words)}</text>'


def _line(x1: float, y1: float, x2: float, y2: float, more: str = 'stroke="currentColor" stroke-opacity="0.4"') -> str:
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" {more}/>'


def _thinned(values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Places of the values that are drawn: no extreme is lost."""
    if len(values) <= 2 * _STRETCHES:
        return np.arange(len(values))
    kept = []
    for stretch in np.array_split(np.arange(len(values)), _STRETCHES):
        part = values[stretch]
        if np.isfinite(part).any():
            kept += [stretch[int(np.nanargmin(part))], stretch[int(np.nanargmax(part))]]
        else:
            kept.append(stretch[0])
    return np.unique(kept)


def _path(x: NDArray[np.float64], y: NDArray[np.float64]) -> str:
    words, begins = [], True
    for at, value in zip(x, y, strict=True):
        if np.isfinite(value):
            words.append(f"{'M' if begins else 'L'}{at:.1f} {value:.1f}")
        begins = not np.isfinite(value)
    return "".join(words)


def lines(words: str, time_s: ArrayLike, panels: Sequence[Lines], shaded: Sequence[tuple[float, float]] = ()) -> str:
    """Panels one below the other over the same time; `shaded`: stretches with another background. `words` are read by a screen reader."""
    of_panel, gap = 96.0, 14.0
    time = np.asarray(time_s, np.float64)
    first, last = float(time[0]), float(time[-1])
    scale = (_WIDTH - _LEFT - _RIGHT) / ((last - first) or 1.0)
    parts: list[str] = []
    top = 6.0
    for panel in panels:
        drawn = [(name, np.asarray(values, np.float64)) for name, values in panel.series]
        real = np.concatenate([values[np.isfinite(values)] for _, values in drawn])
        low, high = (float(real.min()), float(real.max())) if len(real) else (0.0, 1.0)
        middle = high == low
        for begin, end in shaded:
            x = _LEFT + (begin - first) * scale
            parts.append(f'<rect x="{x:.1f}" y="{top:.1f}" width="{(end - begin) * scale:.1f}" height="{of_panel:.1f}" fill="#d00000" fill-opacity="0.12"/>')
        for number, (_, values) in enumerate(drawn):
            places = _thinned(values)
            share = np.full(len(places), 0.5) if middle else (values[places] - low) / (high - low)
            share = np.where(np.isfinite(values[places]), share, np.nan)
            path = _path(_LEFT + (time[places] - first) * scale, top + of_panel * (1.0 - share))
            parts.append(f'<path d="{path}" fill="none" stroke="{_COLOURS[number % len(_COLOURS)]}" stroke-width="1.2"/>')
        parts.append(_line(_LEFT, top, _LEFT, top + of_panel))
        parts.append(_line(_LEFT, top + of_panel, _WIDTH - _RIGHT, top + of_panel))
        parts.append(_text(4, top + of_panel / 2, panel.label))
        parts.append(_text(_LEFT - 6, top + 10, f"{high:.3g}", "end"))
        if not middle:
            parts.append(_text(_LEFT - 6, top + of_panel, f"{low:.3g}", "end"))
        named = [(number, name) for number, (name, _) in enumerate(drawn) if name]
        for place, (number, name) in enumerate(named):
            colour = _COLOURS[number % len(_COLOURS)]
            parts.append(f'<text x="4" y="{top + of_panel / 2 + 15 + 13 * (place // 4):.1f}" dx="{34 * (place % 4)}" fill="{colour}">{escape(name)}</text>')
        top += of_panel + gap
    parts.append(_text(_LEFT, top + 2, f"{first:g} s"))
    parts.append(_text(_WIDTH - _RIGHT, top + 2, f"{last:g} s", "end"))
    return _svg(top + 8, words, parts)


def intervals(words: str, rows: Sequence[tuple[str, float, float, str]]) -> str:
    """Estimates with half of their intervals, each on an axis of its own that holds 0: name, value, half, what is written beside it."""
    of_row, label, letters = 26.0, 275.0, 42
    parts: list[str] = []
    for number, (name, value, half, beside) in enumerate(rows):
        y = 8.0 + of_row * (number + 0.5)
        ends = (value - half, value + half)
        low, high = min(0.0, *ends), max(0.0, *ends)
        scale = (_WIDTH - label - 190.0) / ((high - low) or 1.0)
        zero, at, left, right = (label + (x - low) * scale for x in (0.0, value, *ends))
        parts.append(_text(4, y + 4, name if len(name) <= letters else name[: letters - 1] + "…"))
        parts.append(_line(zero, y - 9, zero, y + 9))
        parts.append(_line(left, y, right, y, f'stroke="{_COLOURS[0]}" stroke-width="3"'))
        parts.append(f'<circle cx="{at:.1f}" cy="{y:.1f}" r="4" fill="{_COLOURS[1]}"/>')
        parts.append(_text(_WIDTH - 180, y + 4, beside))
    return _svg(16.0 + of_row * len(rows), words, parts)


def bars(words: str, rows: Sequence[tuple[str, float]], reference: float, unit: str) -> str:
    """Amounts from 0, and a line at what none of them can be expected to be below."""
    of_row = 18.0
    real = [value for _, value in rows if np.isfinite(value)]
    scale = (_WIDTH - _LEFT - 90.0) / max([reference, *real, 1e-300])
    parts = []
    for number, (name, value) in enumerate(rows):
        y = 6.0 + of_row * number
        length = max(value, 0.0) * scale if np.isfinite(value) else 0.0
        colour = _COLOURS[1] if value > 1.5 * reference else _COLOURS[0]
        parts.append(_text(_LEFT - 6, y + 12, name, "end"))
        parts.append(f'<rect x="{_LEFT}" y="{y + 2:.1f}" width="{length:.1f}" height="{of_row - 5:.1f}" fill="{colour}"/>')
        parts.append(_text(_LEFT + length + 5, y + 12, f"{value:.3g} {unit}".strip()))
    x = _LEFT + reference * scale
    parts.append(_line(x, 4, x, 6 + of_row * len(rows), 'stroke="currentColor" stroke-dasharray="4 3"'))
    return _svg(12.0 + of_row * len(rows), words, parts)
