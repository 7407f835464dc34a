// The page: takes updates, keeps the state, and draws it while the page is visible.

import { showAlarms, showHistory } from "./alarms.js";
import { showCards, showPicture } from "./cards.js";
import { Chart } from "./chart.js";
import { Picture } from "./columns.js";
import { showFacts } from "./facts.js";
import { connect } from "./link.js";
import { showNodes } from "./nodes.js";
import { camera, clock, lasting, number, say, verdictOf, VERDICTS } from "./words.js";

const VERSION = 1;
const page = Object.fromEntries([...document.querySelectorAll("[id]")].map((e) => [e.id, e]));
const state = { cards: new Map(), feeds: [], alarms: [], nodes: [], hasArchive: false, leftOut: false, ahead: 0 };
const chart = new Chart(page.chart, page["chart-words"]);
const spectrogram = new Picture(page.spectrogram);
const strip = new Picture(page.strip, { grey: true });
let wanted = "";
let latestAlarm = null;
let due = false;
let sound = null; // an AudioContext while it is wanted

const now = () => Date.now() + state.ahead; // by the dashboard's clock, whatever ours says
const alone = () => new Set(state.feeds.map((feed) => feed.split("/")[0])).size < 2;
const selected = () => (state.cards.has(wanted) ? wanted : state.feeds[0] || "");
const series = () => document.querySelector("#range input:checked").value;

function onNews(news) {
  if (news.version !== VERSION) {
    say(page.link, "another version of the dashboard: reload the page");
    return;
  }
  state.ahead = news.now_ms - Date.now();
  const before = selected();
  for (const card of news.cards || []) state.cards.set(card.name, card);
  if (news.site) {
    state.feeds = news.site.feeds;
    state.hasArchive = news.site.has_archive;
    state.leftOut = news.site.left_out;
    for (const name of state.cards.keys()) if (!state.feeds.includes(name)) state.cards.delete(name);
  }
  if (news.nodes) state.nodes = news.nodes.list;
  if (news.alarms) {
    takeAlarms(news.alarms.list);
    say(page.unwritten, news.alarms.unwritten);
  }
  if (selected() !== before) turn();
  const own = (part) => part && part.feed === selected();
  if (own(news.chart)) chart.show({ ...news.chart, now_ms: news.now_ms }, state.cards.get(selected()).began_ms);
  if (own(news.spectrogram)) takeSpectrogram(news.spectrogram);
  if (own(news.strip)) takeStrip(news.strip);
  drawSoon();
}

function takeAlarms(alarms) {
  const newest = alarms.length ? alarms[0].number : 0;
  if (latestAlarm !== null && newest > latestAlarm) {
    if (sound) beep(sound);
    say(page.news, `Alarm: ${alarms[0].feed}, ${alarms[0].kind.replaceAll("_", " ")}. ${alarms[0].text}`);
  }
  latestAlarm = newest;
  state.alarms = alarms;
}

// Two tones. Browsers allow sound only after a click, so each page asks for it anew.
function beep(context) {
  [880, 660].forEach((tone, i) => {
    const [source, gain, begin] = [context.createOscillator(), context.createGain(), context.currentTime + 0.25 * i];
    source.frequency.value = tone;
    gain.gain.setValueAtTime(0.2, begin);
    gain.gain.exponentialRampToValueAtTime(0.001, begin + 0.24);
    source.connect(gain).connect(context.destination);
    source.start(begin);
    source.stop(begin + 0.25);
  });
}

function takeSpectrogram(news) {
  const behind = chart.end_ms && news.t_ms ? Math.round((chart.end_ms - news.t_ms) / 1000) : 0;
  const shown = series() === "recent" ? chart.span_s || news.keep : news.keep;
  spectrogram.add(news, Math.min(Math.max(behind, 0), 60), shown);
  const [low, high] = page.spectrogram.parentElement.querySelectorAll("span");
  say(low, (news.nominal_hz - 0.2).toFixed(1));
  say(high, (news.nominal_hz + 0.2).toFixed(1));
  say(page["spectrogram-words"], `${lasting(1000 * shown)}, power about ${number(news.nominal_hz, 0, "Hz")}, 50\u202fdB above the rest`);
}

function takeStrip(news) {
  strip.add(news);
  const seconds = news.frame_rate_hz ? `${number(news.keep / news.frame_rate_hz, 1, "s")}, ` : "";
  const names = { columns: ["right", "left"], rows: ["last row", "first row"], frame: ["", ""] }[news.axis];
  page.strip.parentElement.querySelectorAll("span").forEach((span, i) => say(span, names ? names[i] : ""));
  say(page["strip-words"], `${seconds}less each row's mean; ${number(news.rms_level, 2)} levels rms`);
}

// Selects the feed that is shown in full.
function turn() {
  for (const part of [chart, spectrogram, strip]) part.clear();
  say(page["spectrogram-words"], "");
  say(page["strip-words"], "");
  ask();
  drawSoon();
}

function drawSoon() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    draw();
  });
}

function draw() {
  const cards = state.feeds.map((name) => state.cards.get(name)).filter(Boolean);
  const about = { alone: alone(), selected: selected(), now: now(), hasArchive: state.hasArchive };
  say(page.site, alone() && state.feeds.length ? state.feeds[0].split("/")[0] : "");
  page["no-feeds"].hidden = cards.length > 0;
  page["left-out"].hidden = !state.leftOut;
  showCards(page.cards, cards, about);
  page["no-alarms"].hidden = state.alarms.length > 0;
  showAlarms(page["alarm-list"], state.alarms, about);
  showNodes(page["node-list"], state.nodes, now());
  say(page.tally, tally(cards));
  const card = state.cards.get(selected());
  page.detail.hidden = !card;
  if (!card) return;
  say(page.name, camera(card.name, alone()));
  showFacts(page, card, now());
  showPicture(page.picture, card);
  page.picture.alt = `What ${camera(card.name, alone())} sees`;
}

function tally(cards) {
  const counts = new Map();
  for (const card of cards) {
    const { word } = verdictOf(card);
    counts.set(word, (counts.get(word) || 0) + 1);
  }
  const order = [...Object.values(VERDICTS), "no verdict yet", "not judged"];
  const words = [...counts].sort(([a], [b]) => order.indexOf(a) - order.indexOf(b)).map(([word, n]) => `${n} ${word}`);
  const active = state.alarms.filter((alarm) => alarm.active).length;
  document.title = `${active ? `(${active}) ` : ""}rsenf`;
  return [...words, `${active || "no"} active alarm${active === 1 ? "" : "s"}`].join(" · ");
}

let disconnectedMs = null;
function onState(connected) {
  document.body.classList.toggle("disconnected", !connected);
  disconnectedMs = connected ? null : disconnectedMs ?? Date.now();
  say(page.link, connected ? "connected" : `disconnected at ${clock(disconnectedMs + state.ahead)}, trying again`);
}

function followHash() {
  const found = /^#feed=(.+)$/.exec(location.hash);
  const before = selected();
  if (found) wanted = decodeURIComponent(found[1]);
  if (selected() === before) return;
  turn();
  if (matchMedia("(max-width: 60rem)").matches) page.detail.scrollIntoView();
}

const ask = connect({ onNews, onState, question: () => ({ feed: selected(), series: series() }) });
page.sound.addEventListener("click", () => {
  if (sound) sound.close();
  sound = sound ? null : new AudioContext();
  page.sound.setAttribute("aria-pressed", String(Boolean(sound)));
  if (sound) beep(sound);
});
page.range.addEventListener("change", ask);
page.history.addEventListener("toggle", () => page.history.open && showHistory(page));
page.day.addEventListener("change", () => showHistory(page, page.day.value));
addEventListener("hashchange", followHash);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const part of [chart, spectrogram, strip]) part.onTheme();
});
setInterval(() => say(page.clock, `${clock(now())} UTC`), 500);
setInterval(drawSoon, 1000);
followHash();
