"""The live application: a simulation that is played with in the browser.

Read `session` first, the thread that advances the simulation in real time and executes the page's commands, and
`playground`, the simulation itself with a journal of all that is done to it, which replays. It has the kernels that
a hand will need compiled, in a process of its own. `page` has the view over viser and the clicks, `controls` the panel,
`server` the guard of who may talk to it.
"""
