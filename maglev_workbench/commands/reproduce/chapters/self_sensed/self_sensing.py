"""Chapter 6: self-sensing by demodulation and by the parameter estimator, simulated and on the calibration rig."""

from maglev_workbench.commands.reproduce.chapters.self_sensed.self_sensing_circuit import band_pass, static_table
from maglev_workbench.commands.reproduce.chapters.self_sensed.self_sensing_demodulation import (
    digital_filters,
    estimator_tracking,
    forward_path,
    half_ripple,
)
from maglev_workbench.commands.reproduce.chapters.self_sensed.self_sensing_dynamic import dynamic_calibration
from maglev_workbench.commands.reproduce.chapters.self_sensed.self_sensing_estimator import (
    estimator_response,
    lowest_rate,
)
from maglev_workbench.commands.reproduce.item import Item

ITEMS: tuple[Item, ...] = (
    Item("half-ripple", "The demodulated ripple is half of its closed form", "eq 6.20, App. D", half_ripple),
    Item("digital-filters", "The digital filters", "6.2.2, Figs 6.4, 6.6, App. D", digital_filters),
    Item("forward-path", "Forward path filter, constant and varying duty", "Figs 6.9-6.11", forward_path),
    Item("estimator-tracking", "Parameter estimator beside the forward path filter", "Fig. 6.13", estimator_tracking),
    Item("estimator-response", "Frequency response of the estimator", "Figs 6.14, 6.32", estimator_response),
    Item("band-pass", "Band-pass and rms converter of the circuit", "6.4.1.2, Figs 6.18-6.20", band_pass),
    Item("static-calibration", "Static calibration of the self-sensing output", "Table 6.1, Fig. 6.28", static_table),
    Item("dynamic-calibration", "30° at 150 Hz and the dip at 75 Hz", "Figs 6.30-6.32", dynamic_calibration),
    Item("lowest-rate", "Lowest sampling rate of the digital estimator", "7.2, point 6", lowest_rate),
)
