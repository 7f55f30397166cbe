"""A control engineer: the loop in python-control, its margins there, and what an identified experiment says of them."""

import control
import numpy as np

from maglev_workbench import identify_experiment, load_rig, protocol_experiment, to_control


def study():
    experiment = protocol_experiment(load_rig("hmb_free"), effects={"delay": {"time": 1e-4}})
    plant, controller, closed = to_control(experiment)
    modelled = control.stability_margins(control.frd(controller * plant, np.geomspace(6, 5e4, 2000)))
    print("gain, phase and stability margin of the model:", *modelled[:3])
    found = identify_experiment(experiment)
    print(found)
    measured = control.stability_margins(found.to_control())
    print("the same of the identified loop:", *measured[:3])
    return modelled[1], measured[1], control.step_response(closed, 0.1)


if __name__ == "__main__":
    study()
