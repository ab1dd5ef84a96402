"""The reference-spreading paper: controllers compared on grabs, its Table II and figures, and any plan of this form."""
