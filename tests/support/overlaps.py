"""Overlapping texts in a figure."""

from itertools import combinations

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

PART = 0.02
"""Tolerated overlap as a fraction of the smaller text box, since letters do not fill their boxes."""


def overlapping(figure):
    """Pairs of texts that overlap in the drawn figure."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    # Matplotlib also has ticks beyond the ends of an axis, which it never draws.
    axes = [axis for one in figure.axes for axis in (one.xaxis, one.yaxis)]
    ticks = [tick for axis in axes for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks())]
    drawn = [tick for axis in axes if axis.get_visible() and axis.axes.get_visible() for tick in axis._update_ticks()]
    hidden = {id(label) for tick in ticks for label in (tick.label1, tick.label2)}
    hidden -= {id(label) for tick in drawn for label in (tick.label1, tick.label2)}
    boxes = [
        (text.get_text(), text.get_window_extent(renderer))
        for text in figure.findobj(Text)
        if text.get_visible() and text.get_text().strip() and id(text) not in hidden
    ]
    found = []
    for (one, a), (other, b) in combinations(boxes, 2):
        width = min(a.x1, b.x1) - max(a.x0, b.x0)
        height = min(a.y1, b.y1) - max(a.y0, b.y0)
        if width > 0 and height > 0 and width * height > PART * min(a.width * a.height, b.width * b.height):
            found.append(f"{one!r} and {other!r}")
    return found


def outside(figure):
    """Texts of a drawn figure that its page cuts off."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer, page = canvas.get_renderer(), figure.bbox
    texts = [text for text in figure.texts if text.get_visible() and text.get_text().strip()]
    boxes = [(text.get_text(), text.get_window_extent(renderer)) for text in texts]
    return [text for text, box in boxes if box.x0 < page.x0 or box.x1 > page.x1 or box.y0 < page.y0 or box.y1 > page.y1]
