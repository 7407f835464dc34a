// An image that grows by columns: spectrogram and row strip.

const DARK = [[13, 20, 26], [20, 62, 82], [40, 140, 150], [180, 205, 120], [255, 244, 190]];
const LIGHT = [[246, 249, 250], [190, 220, 226], [70, 150, 165], [20, 80, 110], [10, 30, 50]];
const GREY = [[8, 10, 12], [250, 250, 248]];

function shades(stops) {
  const table = new Uint32Array(256);
  const bytes = new Uint8Array(table.buffer);
  for (let level = 1; level < 256; level++) {
    const place = ((level - 1) / 254) * (stops.length - 1);
    const left = Math.min(Math.floor(place), stops.length - 2);
    for (let c = 0; c < 3; c++) {
      const [a, b] = [stops[left][c], stops[left + 1][c]];
      bytes[4 * level + c] = Math.round(a + (b - a) * (place - left));
    }
    bytes[4 * level + 3] = 255;
  }
  return table; // level 0 stays transparent: nothing is known there
}

export class Picture {
  constructor(canvas, { grey = false } = {}) {
    this.canvas = canvas;
    this.grey = grey;
    this.clear();
    this.onTheme();
  }

  onTheme() {
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    this.table = shades(this.grey ? GREY : dark ? DARK : LIGHT);
    this.draw();
  }

  clear() {
    this.columns = [];
    this.height = 0;
    this.shift = 0;
    this.canvas.getContext("2d").clearRect(0, 0, this.canvas.width, this.canvas.height);
  }

  // Adds columns, and shows the newest ones: `shown` of them, shifted left by `shift`.
  add(news, shift = 0, shown = news.keep) {
    if (news.reset || news.height !== this.height) this.columns = [];
    const data = Uint8Array.from(atob(news.data), (c) => c.charCodeAt(0));
    for (let i = 0; i < news.columns; i++) {
      this.columns.push(data.subarray(i * news.height, (i + 1) * news.height));
    }
    this.columns.splice(0, Math.max(0, this.columns.length - news.keep));
    [this.height, this.shown, this.shift] = [news.height, shown, shift];
    this.draw();
  }

  draw() {
    if (!this.height) return;
    const { canvas, columns, height, shown } = this;
    if (canvas.width !== shown || canvas.height !== height) [canvas.width, canvas.height] = [shown, height];
    const image = new ImageData(shown, height);
    const pixels = new Uint32Array(image.data.buffer);
    const first = shown - this.shift - columns.length;
    columns.forEach((column, i) => {
      const x = first + i;
      if (x < 0) return;
      for (let y = 0; y < height; y++) pixels[y * shown + x] = this.table[column[y]];
    });
    canvas.getContext("2d").putImageData(image, 0, 0);
  }
}
