"""The live application: a simulation that is played with in the browser.

session      a thread that advances the simulation in real time, and executes the page's commands
playground   the simulation itself, and actions on it; a journal of it all, which replays
page         the view and its clicks, over viser; onlooker a view of a program's own world
controls     the panel; main_controls its first part, dials numbers with their sliders
ahead        a process that compiles the kernels that a hand will need
guard        who may talk to the page, and which messages it accepts
"""
