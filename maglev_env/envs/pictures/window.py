"""Frames of an episode's picture, and the window that shows them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import logger
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from maglev_env.envs.pictures.frames import DPI, SIZE


@dataclass
class Window:
    """The window in which `show` draws; figure None: it could not be opened, or it has been closed."""

    figure: Any
    image: Any


def draw_frame(figure: Figure) -> np.ndarray:
    """A figure as an image (720, 960, 3) uint8; equal figures give equal images, and no display is needed."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def show(frame: np.ndarray, window: Window | None) -> Window:
    """Show a frame (height, width, 3) in a window.

    Args:
        frame: the image.
        window: None: a new one is opened; if that fails, a warning is given once.

    Returns:
        The window, for the next call.
    """
    if window is None:
        window = _opened(frame)
    if window.figure is None:
        return window
    import matplotlib.pyplot as plt

    if plt.fignum_exists(window.figure.number):
        window.image.set_data(frame)
        window.figure.canvas.draw_idle()
        window.figure.canvas.flush_events()
    else:  # closed by the user
        window.figure = None
    return window


def hide(window: Window) -> None:
    """Close the window, if there is one."""
    if window.figure is not None:
        import matplotlib.pyplot as plt

        plt.close(window.figure)
        window.figure = None


def _opened(frame: np.ndarray) -> Window:
    import matplotlib.pyplot as plt
    from matplotlib.backends import BackendFilter, backend_registry

    figure = None
    try:
        figure = plt.figure(figsize=SIZE, dpi=DPI)
        if plt.get_backend().lower() in backend_registry.list_builtin(BackendFilter.NON_INTERACTIVE):
            raise RuntimeError(f"matplotlib's backend {plt.get_backend()} opens no windows")
        axes = figure.add_axes((0, 0, 1, 1))
        axes.axis("off")
        image = axes.imshow(frame)
        figure.show()
    except Exception as error:  # every window toolkit has its own
        if figure is not None:
            plt.close(figure)
        logger.warn(f"render_mode='human' shows nothing: {error}; use render_mode='rgb_array' where there is no screen")
        return Window(None, None)
    return Window(figure, image)
