"""Studio: the page in a browser, pictures of stages, and files of other kinds.

Read `animate` first, the main job with pictures and exports around the core's run. `page` is the live page, `render`
draws stages, and `export` converts them.
"""
