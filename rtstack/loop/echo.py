"""What the robot says it was commanded, beside what it was sent."""

from numba import njit


@njit("float64(float64[::1], float64[::1])", cache=True, error_model="numpy")
def largest_difference(tau_J_d, tau_applied):
    """Return the largest difference of two torques (7,), Nm; NaN where one of them is no number."""
    largest = 0.0
    for i in range(7):
        difference = abs(tau_J_d[i] - tau_applied[i])
        if not difference <= largest:
            largest = difference
            if difference != difference:
                return difference
    return largest
