"""Lab: tools of research on a simulation, its gradients, fits, designs, statics and a reference.

`reference` is the step in NumPy and float64, the arbiter of all schedules. `gradients` derives a loss by values of a
scene, `fit` finds values that explain data, `design` finds the balloon that becomes a shape, and `statics` has
equilibria and stiffness of springs, films and gas on the host.
"""
