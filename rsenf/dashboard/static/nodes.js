// All nodes with their last health message.

import { lasting, list, make, number, say } from "./words.js";

export function showNodes(parent, nodes, now) {
  list(parent, nodes, (node) => node.name, create, (item, node) => {
    item.dataset.state = node.state;
    item.title = node.detail;
    say(item.querySelector(".name"), node.name);
    say(item.querySelector(".state"), node.state + (node.state === "silent" ? ` for ${lasting(now - node.heard_ms)}` : ""));
    say(item.querySelector(".more"), more(node));
  });
}

function more(node) {
  const lost = [["dropped", node.dropped], ["missed", node.missed], ["rejected", node.rejected]]
    .filter(([, count]) => count).map(([name, count]) => `${count} ${name}`);
  return [
    node.rate_hz ? `${number(node.rate_hz, 1)} in/s` : "",
    node.latency_s !== null ? `${number(node.latency_s, 2, "s")} late` : "",
    node.memory_mb ? `${node.memory_mb}\u202fMB` : "",
    ...lost,
    node.restarts ? `started again ${node.restarts > 1 ? `${node.restarts} times` : "once"}` : "",
  ].filter(Boolean).join(" · ");
}

const create = () => make("li", "", make("span", "name"), make("span", "state"), make("span", "more quiet"));
