// Numbers, times and elements as the page shows them.

export const known = (value) => value !== null && value !== undefined;

export const number = (value, digits, unit = "") =>
  known(value) ? `${value.toFixed(digits)}${unit && "\u202f" + unit}` : "–";

export const clock = (ms) =>
  known(ms) ? new Date(ms).toISOString().slice(11, 19) : "–";

export const moment = (ms) =>
  known(ms) ? new Date(ms).toISOString().replace("T", " ").slice(0, 19) + " UTC" : "–";

export function lasting(ms) {
  const s = Math.max(0, Math.round(ms / 1000));
  if (s < 100) return `${s}\u202fs`;
  if (s < 6000) return `${Math.round(s / 60)}\u202fmin`;
  return s < 172800 ? `${(s / 3600).toFixed(1)}\u202fh` : `${Math.round(s / 86400)}\u202fdays`;
}

export const camera = (feed, alone) => (alone ? feed.split("/").slice(1).join("/") : feed);

// Sets a text only if it differs, to avoid a layout.
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function make(tag, className = "", ...children) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  element.append(...children);
  return element;
}

// Keeps one element for each item, created once, in the order of the items.
export function list(parent, items, key, create, update) {
  const there = new Map([...parent.children].map((child) => [child.dataset.key, child]));
  items.forEach((item, place) => {
    const name = String(key(item));
    let child = there.get(name);
    if (!child) {
      child = create(item);
      child.dataset.key = name;
    }
    there.delete(name);
    if (parent.children[place] !== child) parent.insertBefore(child, parent.children[place] || null);
    update(child, item);
  });
  for (const child of there.values()) child.remove();
}

const SIGNS = {
  live: "M4 12l5 5L20 6",
  stale: "M4 12a8 8 0 1 1 3 6M4 19v-6h6",
  frozen: "M8 5v14M16 5v14",
  no_signal: "M5 5l14 14M12 3a9 9 0 1 1-.1 0",
  undecided: "M8 8a4 4 0 1 1 5 4q-1 .5-1 3M12 19v.1",
  unjudged: "M6 12h12",
  alarm: "M12 4L2.5 20h19zM12 10v5M12 17.5v.1",
};

// A symbol for a word, so that it isn't told by colour only.
export function sign(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("class", "sign");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(svg.namespaceURI, "path");
  path.setAttribute("d", SIGNS[name] || SIGNS.undecided);
  svg.append(path);
  return svg;
}

export const VERDICTS = {
  live: "live",
  stale: "stale",
  frozen: "frozen",
  no_signal: "no signal",
  undecided: "undecided",
};

export function verdictOf(card) {
  if (card.live) {
    return { name: card.live.verdict, word: VERDICTS[card.live.verdict] || card.live.verdict };
  }
  return { name: "unjudged", word: card.is_judged ? "no verdict yet" : "not judged" };
}

const URGENCY = { stale: 0, frozen: 0, no_signal: 2, undecided: 2, unjudged: 3, live: 4 };

// Feeds of a lower one come first.
export function urgency(card) {
  const byVerdict = URGENCY[verdictOf(card).name] ?? 2;
  return card.alarms ? Math.min(byVerdict, 1) : byVerdict;
}

// Shows a verdict's symbol and text in an element.
export function showVerdict(element, card, text) {
  const { name } = verdictOf(card);
  if (element.dataset.verdict !== name) {
    element.dataset.verdict = name;
    element.replaceChildren(sign(name), make("span"));
  }
  say(element.lastChild, text);
}
