"""The loop: reads both arms, runs the tick and the judge, answers, and publishes what happened."""
