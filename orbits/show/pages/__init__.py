"""Results on pages: cells of notebooks, and animated figures of Bokeh, alone in a file or live."""
