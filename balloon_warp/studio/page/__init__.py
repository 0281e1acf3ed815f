"""The live application: a simulation that is played with in the browser.

Read `session` first, the thread that advances the simulation in real time and executes the page's commands, and
`playground`, the simulation itself with a journal of all that is done to it, which replays. `page` has the view over
viser, `controls` the panel, `pointing` the clicks, `server` the guard of who may talk to it; `ahead` compiles the
kernels that a hand will need, in a process of its own.

"""
