"""Error against seconds, both logarithmic, one panel a scene, as SVG."""

import math

COLORS = ("#c8321e", "#2668b0", "#6b7280", "#2f8f4e")
WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 250, 230, 54, 34, 40
COLUMNS = 4


def chart(points):
    """`points`: {scene: {renderer: [(seconds, error), ...]}}."""
    parts = []
    for index, (scene, series) in enumerate(points.items()):
        parts.append(f'<g transform="translate({index % COLUMNS * (WIDTH + LEFT)},{index // COLUMNS * (HEIGHT + TOP + BOTTOM)})">')
        parts += panel(scene, series)
        parts.append("</g>")
    columns, rows = min(len(points), COLUMNS), math.ceil(len(points) / COLUMNS)
    width, height = columns * (WIDTH + LEFT) + 20, rows * (HEIGHT + TOP + BOTTOM) + 34
    names = list(dict.fromkeys(name for series in points.values() for name in series))
    for index, name in enumerate(names):
        x = LEFT + 130 * index
        parts.append(f'<circle cx="{x}" cy="{height - 18}" r="4" fill="{COLORS[index]}"/>')
        parts.append(f'<text x="{x + 10}" y="{height - 14}">{name}</text>')
    style = "<style>text{font:12px sans-serif;fill:#333}.t{font-weight:bold}.g{stroke:#ddd}.a{fill:#666;font-size:11px}</style>"
    back = f'<rect width="{width}" height="{height}" fill="#fff"/>'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">'
    return "\n".join([head, "<title>relMSE against seconds of rendering; lower left is better</title>", style, back, *parts, "</svg>\n"])


def panel(scene, series):
    shown = {name: [(s, e) for s, e in line if s > 0 and e > 0] for name, line in series.items()}
    every = [point for line in shown.values() for point in line]
    x, x_ticks = axis([s for s, _ in every], LEFT, LEFT + WIDTH - 20)
    y, y_ticks = axis([e for _, e in every], TOP + HEIGHT, TOP)
    out = [f'<text class="t" x="{LEFT}" y="{TOP - 12}">{scene}</text>']
    for value in x_ticks:
        out.append(f'<line class="g" x1="{x(value):.1f}" x2="{x(value):.1f}" y1="{TOP}" y2="{TOP + HEIGHT}"/>')
        out.append(f'<text class="a" x="{x(value):.1f}" y="{TOP + HEIGHT + 15}" text-anchor="middle">{value:g}</text>')
    for value in y_ticks:
        out.append(f'<line class="g" x1="{LEFT}" x2="{LEFT + WIDTH - 20}" y1="{y(value):.1f}" y2="{y(value):.1f}"/>')
        out.append(f'<text class="a" x="{LEFT - 5}" y="{y(value) + 4:.1f}" text-anchor="end">{value:g}</text>')
    out.append(f'<text class="a" x="{LEFT + WIDTH / 2 - 10}" y="{TOP + HEIGHT + 30}" text-anchor="middle">seconds</text>')
    out.append(f'<text class="a" x="{LEFT - 5}" y="{TOP - 12}" text-anchor="end">relMSE</text>')
    for color, line in zip(COLORS, shown.values()):
        path = " ".join(f"{x(s):.1f},{y(e):.1f}" for s, e in line)
        out.append(f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="2"/>')
        out += [f'<circle cx="{x(s):.1f}" cy="{y(e):.1f}" r="3.5" fill="{color}"/>' for s, e in line]
    return out


def axis(values, start, end):
    """A logarithmic scale around `values`, and its ticks."""
    low, high = math.log10(min(values) / 1.3), math.log10(max(values) * 1.3)

    def scale(value):
        return start + (math.log10(value) - low) / (high - low) * (end - start)

    steps = [m * 10.0**p for p in range(math.floor(low), math.ceil(high) + 1) for m in ((1,) if high - low > 2 else (1, 3))]
    return scale, [s for s in steps if low <= math.log10(s) <= high]
