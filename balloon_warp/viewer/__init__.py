"""The live application: a simulation that is played with in the browser.

session      a thread that advances the simulation in real time, and does what the page asks
playground   the simulation itself, and what can be done to it; a journal of it all, which replays
page         what is seen and clicked, over viser; onlooker what a program shows of a world of its own
controls     the panel; hands_on what comes first in it, dials numbers with their sliders
ahead        a process that compiles what a hand will need
guard        who may talk to the page, and what is heard
"""
