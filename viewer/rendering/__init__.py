"""Pictures of a scene, drawn by the live page in a browser without a window.

- `camera`: named views of a machine, and fixed cameras
- `picture`: size, format and pixels of a picture
- `browser`: the browser as a child process
- `page_server`: the page for that browser, on the loopback address
- `page_renderer`: PageRenderer: all of these
"""
