"""Impact-aware dual-arm control: from the demonstration to the trial to the log."""

from hal.compilation import keep_compiled_code_by_its_sources

keep_compiled_code_by_its_sources()
