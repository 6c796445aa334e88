"""Results on pages: what a notebook shows of them, and figures of Bokeh that move, alone in a file or live."""
