// Facts about the feed that is shown in full, in words and numbers.

import { clock, known, lasting, list, make, moment, number, say, showVerdict, verdictOf } from "./words.js";
import { healthOf } from "./cards.js";

export function showFacts(page, card, now) {
  const { word } = verdictOf(card);
  const live = card.live;
  const since = live?.since_ms ? `, since ${clock(live.since_ms)} (${lasting(now - live.since_ms)})` : "";
  showVerdict(page.verdict, card, word + since);
  say(page.evidence, evidence(card));
  list(page.facts, factsOf(card, now), (fact) => fact.name, create, (item, fact) => {
    item.classList.toggle("wrong", Boolean(fact.wrong));
    say(item.querySelector(".value"), fact.value);
    say(item.querySelector(".more"), fact.more || "");
    const bar = item.querySelector("rect.interval");
    item.querySelector("svg").toggleAttribute("hidden", !fact.interval);
    if (!fact.interval) return;
    const [low, high] = fact.interval;
    bar.setAttribute("x", (100 * low - 0.4).toFixed(2));
    bar.setAttribute("width", Math.max(0.8, 100 * (high - low) + 0.8).toFixed(2));
  });
}

function evidence(card) {
  if (card.live) {
    const origin = card.live.origin_ms ? `the picture is of ${moment(card.live.origin_ms)}` : "";
    return [card.live.evidence, origin].filter(Boolean).join("; ");
  }
  if (card.is_judged === false) return "No node of this graph judges whether this feed is live (kind: live).";
  return card.is_judged ? "" : "No verdict has been received: perhaps nobody judges this feed.";
}

function factsOf(card, now) {
  const { live, idle, match } = card;
  const wrong = healthOf(card, now);
  const width = idle && known(idle.low) ? Math.max(100 * (idle.high - idle.low), 1e-4) : 1;
  const digits = Math.min(Math.max(1 - Math.floor(Math.log10(width)), 1), 4);
  const nodes = Object.entries(card.nodes).map(([name, state]) => `${name} ${state || "not heard of"}`);
  return [
    { name: "ENF now", value: known(card.enf_hz) ? number(card.enf_hz, 5, "Hz") : "none usable",
      more: known(card.enf_std_hz) ? `± ${number(1000 * card.enf_std_hz, 2, "mHz")}` : card.enf_reason },
    { name: "SNR", value: number(card.snr_db, 1, "dB"),
      more: known(card.steady_ratio) ? `${Math.round(100 * card.steady_ratio)} % of the picture steady` : "" },
    { name: "Lag behind the grid", value: within(live?.lag_s, live?.lag_std_s, 2, "s"),
      more: live && known(live.log10_lr) ? `log10 LR ${number(live.log10_lr, 1)} for live` : "" },
    { name: "Camera's clock", value: within(live?.clock_ppm ?? match?.clock_ppm, live?.clock_std_ppm, 1, "ppm"),
      more: "positive is fast" },
    { name: "Idle period", value: idle && known(idle.ratio) ? `${number(100 * idle.ratio, digits, "%")}` : idle?.verdict.replace("_", " ") ?? "–",
      more: idle && known(idle.low) ? `${number(100 * idle.low, digits)} to ${number(100 * idle.high, digits, "%")} (95 %)` : idle?.reason ?? "",
      interval: idle && known(idle.low) ? [idle.low, idle.high] : null },
    { name: "Match", value: match ? match.decision.replace("_", " ") : "–",
      more: match ? [known(match.log10_lr) ? `log10 LR ${number(match.log10_lr, 1)}` : "",
        known(match.correlation) ? `correlation ${number(match.correlation, 3)}` : "",
        match.start_ms ? `from ${moment(match.start_ms)}` : ""].filter(Boolean).join(", ") || match.text : "" },
    { name: "Stream", value: card.has_ended ? "ended" : card.heard_ms ? `heard ${lasting(now - card.heard_ms)} ago` : "–",
      more: card.streams > 1 ? `began ${card.streams} times, last at ${clock(card.began_ms.at(-1))}` : "" },
    { name: "Health", value: wrong || "well", more: nodes.join(", "), wrong: Boolean(wrong) },
  ];
}

function within(value, std, digits, unit) {
  if (!known(value)) return "–";
  return known(std) ? `${number(value, digits)} ± ${number(std, digits, unit)}` : number(value, digits, unit);
}

function create(fact) {
  const ns = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(ns, "svg");
  svg.setAttribute("viewBox", "0 0 100 4");
  svg.setAttribute("preserveAspectRatio", "none");
  svg.setAttribute("aria-hidden", "true");
  for (const [name, width] of [["whole", 100], ["interval", 0]]) {
    const rect = document.createElementNS(ns, "rect");
    rect.setAttribute("class", name);
    rect.setAttribute("width", width);
    rect.setAttribute("height", 4);
    svg.append(rect);
  }
  return make("div", "", make("dt", "", fact.name), make("dd", "", make("span", "value"), svg, make("span", "more")));
}
