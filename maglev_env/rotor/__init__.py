"""The free rotor in two bearings: five degrees of freedom, spinning, unbalanced, and able to touch down."""
