// The arms of the cell, one or two: their sides, left before right, and words for all of them.

export const SIDES = document.getElementById("bar").dataset.sides.split(" ");
export const TWO = SIDES.length === 2;
export const REAL = document.querySelector(".badge.real") !== null; // every motion of theirs takes a clutch that is held
export const ALL_ARMS = TWO ? "both arms" : "the arm";
export const UNCHANGED = TWO ? "Both arms stay as they are." : "The arm stays as it is.";
