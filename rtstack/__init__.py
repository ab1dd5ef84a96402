"""Impact-aware dual-arm control: from the demonstration to the trial to the log."""
