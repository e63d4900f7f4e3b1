/** How many points a picture may have so that the next one comes in time. */
export class Pace {
  /** Nothing moved for so long, ms: the next picture may take its time. */
  static readonly STILL_MS = 250;
  /** Later than this is seen, ms: 30 pictures a second. */
  private static readonly LATE_MS = 34;
  /** So early there is room for more points, ms. */
  private static readonly EARLY_MS = 20;
  /** Pictures that are looked at together. */
  private static readonly WINDOW = 12;
  private static readonly STEPS = [1, 0.75, 0.5];
  /** Small pictures that come later than this leave nothing for anything else, ms; then one comes every so often. */
  private static readonly CROWDED_FROM_MS = 70;
  private static readonly CROWDED_MS = 100;
  private static readonly CROWDED_WINDOWS = 8;
  private crowded = 0;
  private last = -Infinity;
  private sum = 0;
  private count = 0;
  private step = 0;
  /** Windows in which there was room in a row: more points are tried more and more rarely. */
  private good = 0;
  private patience = 2;

  /** Share of the screen's points, for a picture at a time (ms). */
  ratio(now: number): number {
    const gap = now - this.last;
    this.last = now;
    if (gap > Pace.STILL_MS - 20) {
      this.sum = this.count = 0;
      return 1;
    }
    this.sum += gap;
    this.count += 1;
    if (this.count >= Pace.WINDOW) {
      const mean = this.sum / this.count;
      this.sum = this.count = 0;
      // What is held back cannot tell whether there would be room: it is tried again after a while.
      if (this.crowded > 0) this.crowded -= 1;
      else if (this.step === Pace.STEPS.length - 1 && mean > Pace.CROWDED_FROM_MS) this.crowded = Pace.CROWDED_WINDOWS;
      if (mean > Pace.LATE_MS) {
        if (this.good >= 1 || this.step === 0) this.patience = Math.min(64, 2 * this.patience);
        this.good = 0;
        this.step = Math.min(Pace.STEPS.length - 1, this.step + 1);
      } else if (mean < Pace.EARLY_MS) {
        this.good += 1;
        if (this.good >= this.patience) {
          this.good = 0;
          this.step = Math.max(0, this.step - 1);
        }
      }
    }
    return Pace.STEPS[this.step] ?? 1;
  }

  /** How long to wait before the next picture, ms: where even small ones come late, clicks go first. */
  pause(): number {
    return this.crowded > 0 ? Pace.CROWDED_MS : 0;
  }

  isReduced(): boolean {
    return this.step > 0;
  }
}
