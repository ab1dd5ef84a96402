// The One-Euro filter (Casiez et al., CHI 2012): a low pass that lets fast motions through. A hand at rest trembles less,
// a hand that moves is hardly later.

const RATE_CUTOFF_HZ = 1; // of the speed's own low pass, as in the paper

const share = (cutoffHz, elapsedS) => {
  const tau = 1 / (2 * Math.PI * cutoffHz);
  return 1 / (1 + tau / elapsedS);
};

export class OneEuro {
  // leastHz: the cutoff at rest; perUnit: how much it rises with the speed, Hz per unit/s.
  constructor(leastHz, perUnit) {
    Object.assign(this, { leastHz, perUnit });
    this.forget();
  }

  forget() {
    this.value = null;
    this.rate = null;
    this.atS = null;
  }

  // values: an array of numbers; atS: their time, s.
  filter(values, atS) {
    if (this.value === null || atS <= this.atS) {
      if (this.value === null) {
        this.value = [...values];
        this.rate = values.map(() => 0);
        this.atS = atS;
      }
      return this.value;
    }
    const elapsedS = atS - this.atS;
    this.atS = atS;
    for (const [k, value] of values.entries()) {
      const rate = (value - this.value[k]) / elapsedS;
      this.rate[k] += share(RATE_CUTOFF_HZ, elapsedS) * (rate - this.rate[k]);
    }
    const speed = Math.hypot(...this.rate);
    const weight = share(this.leastHz + this.perUnit * speed, elapsedS);
    for (const [k, value] of values.entries()) this.value[k] += weight * (value - this.value[k]);
    return this.value;
  }
}
