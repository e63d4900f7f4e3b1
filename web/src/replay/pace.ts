/** How many pixels a frame may have so that the next one is on time. */
export class Pace {
  /** Idle time after which a frame may take longer, ms. */
  static readonly STILL_MS = 250;
  /** Visible delay, ms: 30 frames per second. */
  private static readonly LATE_MS = 34;
  /** Frame interval below which more pixels are affordable, ms. */
  private static readonly EARLY_MS = 20;
  /** Frames per window of the control. */
  private static readonly WINDOW = 12;
  private static readonly STEPS = [1, 0.75, 0.5];
  /** If even small frames come later than this, they leave no time for anything else, ms; then frames are spaced out. */
  private static readonly CROWDED_FROM_MS = 70;
  private static readonly CROWDED_MS = 100;
  private static readonly CROWDED_WINDOWS = 8;
  private crowded = 0;
  private last = -Infinity;
  private sum = 0;
  private count = 0;
  private step = 0;
  /** Consecutive windows with spare time: more pixels are tried at increasing intervals. */
  private good = 0;
  private patience = 2;

  /** Share of the screen's pixels for a frame at a time (ms). */
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
      // While frames are held back, spare time cannot be measured: tried again after a while.
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

  /** How long to wait before the next frame, ms: if even small ones are late, clicks have priority. */
  pause(): number {
    return this.crowded > 0 ? Pace.CROWDED_MS : 0;
  }

  isReduced(): boolean {
    return this.step > 0;
  }
}
