"""The live page: a node that serves a 3-D view in the browser."""
