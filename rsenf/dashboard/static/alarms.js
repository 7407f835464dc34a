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
  });
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
    make("p", "text"), make("p", "figures quiet"), files);
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
