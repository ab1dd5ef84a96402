"""What a notebook needs: a simulated cell as one object, several trials on worker processes, tables and figures."""

from hal.base.extras import require

require("sim")
require("campaign")  # its `distributed` brings cloudpickle, too
