"""Pictures of episodes, drawn by matplotlib."""

from maglev_env.presented import matplotlib_figure

matplotlib_figure()  # or says what to install
