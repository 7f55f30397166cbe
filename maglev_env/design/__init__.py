"""Design rules of the levitated pump: stator, controller gains, motor, temperature and hydraulics (D ch. 3)."""
