// Summary cards of all feeds.

import { camera, known, lasting, list, make, number, say, showVerdict, urgency, verdictOf } from "./words.js";

const SPARK = [120, 26];

export function showCards(parent, cards, { alone, selected, now }) {
  const worstFirst = [...cards].sort((a, b) => urgency(a) - urgency(b));
  list(parent, worstFirst, (card) => card.name, create, (item, card) => {
    const link = item.firstChild;
    const { word } = verdictOf(card);
    if (card.name === selected) link.setAttribute("aria-current", "true");
    else link.removeAttribute("aria-current");
    item.dataset.verdict = verdictOf(card).name;
    say(link.querySelector(".name"), camera(card.name, alone));
    const since = card.live?.since_ms ? ` for ${lasting(now - card.live.since_ms)}` : "";
    showVerdict(link.querySelector(".verdict"), card, word + since);
    say(link.querySelector(".enf"), known(card.enf_hz) ? `${number(card.enf_hz, 4, "Hz")}` : "no ENF");
    say(link.querySelector(".snr"), known(card.snr_db) ? `SNR ${number(card.snr_db, 0, "dB")}` : "");
    say(link.querySelector(".health"), healthOf(card, now));
    const alarms = link.querySelector(".alarms");
    say(alarms, card.alarms ? `${card.alarms} alarm${card.alarms > 1 ? "s" : ""}` : "");
    drawSparks(link.querySelector("polyline"), card.sparks_hz);
    showPicture(link.querySelector("img"), card);
  });
}

function create(card) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", `0 0 ${SPARK[0]} ${SPARK[1]}`);
  svg.setAttribute("preserveAspectRatio", "none");
  svg.setAttribute("aria-hidden", "true");
  svg.append(document.createElementNS(svg.namespaceURI, "polyline"));
  const image = make("img");
  image.alt = "";
  image.hidden = true;
  const link = make("a", "card",
    make("span", "thumb", image),
    make("span", "top", make("span", "name"), make("span", "alarms")),
    make("span", "verdict"),
    make("span", "figures", make("span", "enf"), make("span", "snr")),
    svg,
    make("span", "health"));
  link.href = `#feed=${encodeURIComponent(card.name)}`;
  return make("li", "", link);
}

export function healthOf(card, now) {
  const wrong = Object.entries(card.nodes).filter(([, state]) => ["silent", "failed", "lost"].includes(state));
  if (wrong.length) return wrong.map(([name, state]) => `${name} ${state}`).join(", ");
  if (card.has_ended) return "its stream has ended";
  if (!card.heard_ms) return "nothing received yet";
  if (now - card.heard_ms > 5000) return `nothing for ${lasting(now - card.heard_ms)}`;
  return card.rows_reason || card.enf_reason || "";
}

export function showPicture(image, card) {
  image.hidden = !card.picture;
  if (!card.picture || image.dataset.picture === `${card.name} ${card.picture}`) return;
  image.dataset.picture = `${card.name} ${card.picture}`;
  image.src = `pictures/${encodeURI(card.name)}.jpg?${card.picture}`;
}

function drawSparks(line, values) {
  const there = values.filter(known);
  const [low, high] = [Math.min(...there), Math.max(...there)];
  const span = Math.max(high - low, 0.004);
  const left = SPARK[0] * (1 - values.length / 60);
  const points = values.map((hz, i) => known(hz)
    ? `${(left + (i * SPARK[0]) / 60).toFixed(1)},${(SPARK[1] - 3 - ((hz - low) / span) * (SPARK[1] - 6)).toFixed(1)}`
    : "");
  const text = points.filter(Boolean).join(" ");
  if (line.getAttribute("points") !== text) line.setAttribute("points", text);
}
