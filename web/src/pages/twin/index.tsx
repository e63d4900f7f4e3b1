/** The twin: from a log to a model that agrees with it, in six steps. The address holds all state. */
import { Add } from "./add";
import { Drop } from "./drop";
import { Fails } from "./fails";
import { Missing } from "./missing";
import { Read } from "./read";
import { createTwin } from "./state";
import { Vehicle } from "./vehicle";

export default function TwinPage() {
  const twin = createTwin();
  return (
    <>
      <div class="row">
        <h1>Twin</h1>
        <span class="muted">Compare a model with a flight, see where it fails, find what is missing, add it, watch the error fall.</span>
      </div>
      <Drop twin={twin} />
      <Read twin={twin} />
      <Vehicle twin={twin} />
      <Fails twin={twin} />
      <Missing twin={twin} />
      <Add twin={twin} />
    </>
  );
}
