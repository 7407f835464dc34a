// Alarms, each with its recordings for download and replay.

import { camera, clock, known, lasting, list, make, moment, number, say, sign } from "./words.js";

const SHOWN = 60;
const SEVERITIES = { info: "note", warning: "warning", alarm: "alarm" };

export function showAlarms(parent, alarms, { alone, hasArchive }) {
  list(parent, alarms.slice(0, SHOWN), (alarm) => alarm.number, create, (item, alarm) => {
    item.dataset.severity = alarm.severity;
    item.classList.toggle("ended", !alarm.active);
    const [details] = item.children;
    say(details.querySelector(".kind"), alarm.kind.replaceAll("_", " "));
    say(details.querySelector(".feed"), camera(alarm.feed, alone));
    say(details.querySelector(".when"), clock(alarm.start_ms));
    say(details.querySelector(".state"), stateOf(alarm));
    say(details.querySelector(".text"), alarm.text);
    say(details.querySelector(".figures"), figures(alarm));
    details.querySelector(".files").dataset.archive = hasArchive ? "yes" : "no";
    say(details.querySelector(".seen"), seenBy(alarm));
    details.querySelector("form").hidden = Boolean(alarm.ack);
  });
}

const seenBy = ({ ack }) =>
  ack ? `Acknowledged by ${ack.by}, ${moment(ack.at_ms)}${ack.note && `: ${ack.note}`}` : "";

function acknowledging(number_) {
  const name = make("input");
  const note = make("input");
  const send = make("button", "", "Acknowledge");
  const answer = make("span", "quiet");
  const form = make("form", "", name, note, send, answer);
  Object.assign(name, { name: "by", required: true, maxLength: 64, placeholder: "your name", ariaLabel: "your name" });
  Object.assign(note, { name: "note", maxLength: 500, placeholder: "note", ariaLabel: "note" });
  name.value = localStorage.getItem("name") || "";
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    localStorage.setItem("name", name.value);
    try {
      const reply = await fetch(`alarms/${number_}/acknowledgement`, {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify({ by: name.value, note: note.value }),
      });
      say(answer, reply.ok ? "" : (await reply.text()).trim());
    } catch {
      say(answer, "The dashboard can't be reached.");
    }
  });
  return form;
}

// Lists the alarms of a day, the last one unless a day is given.
export async function showHistory(page, day = "") {
  let found;
  try {
    found = await (await fetch(`history?day=${encodeURIComponent(day)}`)).json();
  } catch {
    say(page["history-words"], "The dashboard can't be reached.");
    return;
  }
  page.day.replaceChildren(...found.days.map(([name, count]) => new Option(`${name} (${count})`, name, false, name === found.day)));
  page["history-list"].replaceChildren(...found.alarms.map((alarm) => {
    const words = make("p", "", make("span", "when", clock(alarm.start_ms)), ` ${alarm.feed} `,
      make("span", "kind", alarm.kind.replaceAll("_", " ")), ` ${stateOf(alarm)}`);
    const item = make("li", "", words, make("p", "quiet", `${alarm.text} (${figures(alarm)})`), make("p", "seen", seenBy(alarm)));
    item.dataset.severity = alarm.severity;
    return item;
  }));
  say(page["history-words"], found.days.length ? "" : "None yet.");
}

const stateOf = (alarm) => {
  const word = SEVERITIES[alarm.severity] || alarm.severity;
  return alarm.active ? word : `${word}, over`;
};

function figures(alarm) {
  const lasted = alarm.end_ms > alarm.start_ms ? `, ${lasting(alarm.end_ms - alarm.start_ms)} long` : "";
  const tripped = known(alarm.value)
    ? `. ${number(alarm.value, 3, alarm.unit)}${known(alarm.limit) ? `, limit ${number(alarm.limit, 3, alarm.unit)}` : ""}`
    : "";
  return `${moment(alarm.start_ms)}${lasted}${tripped}`;
}

function create(alarm) {
  const files = make("div", "files");
  const details = make("details", "",
    make("summary", "", sign("alarm"), make("span", "kind"), make("span", "feed"),
      make("span", "when"), make("span", "state")),
    make("p", "text"), make("p", "figures quiet"), make("p", "seen"), acknowledging(alarm.number), files);
  details.addEventListener("toggle", () => details.open && showFiles(files, alarm.number));
  return make("li", "", details);
}

async function showFiles(parent, number_) {
  if (parent.dataset.archive === "no") {
    parent.replaceChildren(make("p", "quiet", "No archive is configured, so there is no recording."));
    return;
  }
  let files = [];
  try {
    files = (await (await fetch(`alarms/${number_}/recordings`)).json()).files;
  } catch {
    parent.replaceChildren(make("p", "quiet", "The dashboard can't be reached."));
    return;
  }
  const again = make("button", "", "Look again");
  again.type = "button";
  again.addEventListener("click", () => showFiles(parent, number_));
  const none = make("p", "quiet", "No recording of it yet.");
  parent.replaceChildren(...(files.length ? files.map(fileOf) : [none]), again);
}

function fileOf(file) {
  const link = make("a", "", file.name);
  link.href = file.url.split("/").map(encodeURIComponent).join("/");
  link.download = file.name;
  const state = file.is_whole ? "" : ", still being written";
  const copy = make("button", "", "Copy");
  copy.type = "button";
  const line = make("code", "", file.replay);
  copy.addEventListener("click", async () => {
    getSelection().selectAllChildren(line);
    await navigator.clipboard?.writeText(file.replay).catch(() => {});
    say(copy, navigator.clipboard ? "Copied" : "Selected");
  });
  return make("div", "file", link, ` ${number(file.size_mb, 1, "MB")}${state}`, make("div", "line", line, copy));
}
