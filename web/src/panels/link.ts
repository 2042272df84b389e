// State of the connection, with the age of the data.

import { effect } from "@preact/signals-core";
import { announce } from "../base/announce.js";
import type { Connection } from "../protocol/connection.js";
import { byId, write } from "../base/dom.js";
import type { Session } from "../state/session.js";
import { words } from "../words/words.js";

/** Age above which the data are reported as old. */
const OLD_MS = 250;
/** Age from which the text omits it, as before the first pose. */
const NO_AGE_MS = 1e6;

export function showLink(session: Session, connection: Connection): void {
  effect(() => {
    const link = connection.link.value;
    const isStale = link === "connected" && !session.isFresh.value;
    document.body.classList.toggle("stale", !session.isFresh.value);
    byId("link").dataset.link = isStale ? "stale" : link;
  });
  let announced = "";
  session.onFigures(() => {
    const link = connection.link.value;
    write(byId("link-text"), linkText(session, connection));
    const status = words.link[link] + (link === "connected" && !session.isFresh.value ? ` · ${words.oldPoses}` : "");
    // nothing to announce before a pose
    if (!session.pose.value || status === announced) return;
    announced = status;
    announce(status);
  });
}

function linkText(session: Session, connection: Connection): string {
  const link = connection.link.value;
  const age_ms = session.age_ms.value;
  const age =
    age_ms >= NO_AGE_MS
      ? ""
      : age_ms > OLD_MS
        ? ` · ${words.dataAge(`${(age_ms / 1000).toFixed(1)} s`)}`
        : ` · ${Math.round(age_ms)} ms`;
  const roundTrip_ms = connection.roundTrip_ms.value;
  const trip = Number.isFinite(roundTrip_ms) ? ` · ${words.answerTook(`${roundTrip_ms.toFixed(0)} ms`)}` : "";
  const role = connection.allows("hand") ? "" : ` · ${words.viewOnly}`;
  return words.link[link] + (link === "connected" ? role + age + trip : session.pose.value ? age : "");
}
