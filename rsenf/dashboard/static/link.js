// The WebSocket to the dashboard, with reconnection by exponential backoff.

const FIRST_MS = 500;
const LONGEST_MS = 4000;
// The server sends a message every five seconds at least.
const SILENCE_MS = 12000;

export function connect({ onNews, onState, question }) {
  let socket = null;
  let pause = FIRST_MS;
  let silence = 0;

  const listenOn = () => {
    clearTimeout(silence);
    silence = setTimeout(() => socket.close(), SILENCE_MS);
  };

  const open = () => {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const mine = new WebSocket(`${scheme}://${location.host}/news`);
    socket = mine;
    mine.onopen = () => {
      pause = FIRST_MS;
      ask();
      listenOn();
    };
    mine.onmessage = (event) => {
      listenOn();
      onState(true);
      onNews(JSON.parse(event.data));
    };
    mine.onclose = () => {
      clearTimeout(silence);
      onState(false);
      setTimeout(open, pause);
      pause = Math.min(2 * pause, LONGEST_MS);
    };
  };

  const ask = () => {
    if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(question()));
  };

  open();
  return ask;
}
