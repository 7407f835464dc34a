// Chart of ENF and reference (uPlot), with the standard error as a band, and gaps.

import { clock, known, number } from "./words.js";

const SPAN_S = { recent: [120, 600], hour: [600, 3600] }; // shown at least and at most
const WHERE = { clock: "at the same time", match: "at the time that was matched",
  claim: "at the time that is claimed" };
const HEIGHT = 230;
const LEFT = 64; // as wide as the labels beside the pictures below

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class Chart {
  constructor(parent, words) {
    this.parent = parent;
    this.words = words;
    this.chart = null;
    this.span_s = null;
    this.began = [];
    new ResizeObserver(() => this.fit()).observe(parent);
  }

  clear() {
    this.chart?.destroy();
    this.chart = null;
    this.news = null;
    this.span_s = null;
    this.words.textContent = "";
  }

  onTheme() {
    const news = this.news;
    this.clear();
    if (news) this.show(news, this.began);
  }

  fit() {
    const width = this.parent.clientWidth;
    if (this.chart && width && width !== this.chart.width) this.chart.setSize({ width, height: HEIGHT });
  }

  show(news, began) {
    this.news = news;
    this.began = began;
    if (!this.chart) this.chart = this.build();
    const t = news.t_ms.map((ms) => ms / 1000);
    const around = (sigma) =>
      news.enf_hz.map((hz, i) => (known(hz) ? hz + sigma * (news.std_hz[i] || 0) : null));
    const end = t.length ? t[t.length - 1] : news.now_ms / 1000;
    const [least, most] = SPAN_S[news.series];
    const there = 60 * Math.ceil((end - (t.length ? t[0] : end)) / 60 + 0.2);
    this.span_s = Math.min(Math.max(there, least), most);
    this.chart.batch(() => {
      this.chart.setData([t, news.reference_hz, around(1), around(-1), news.enf_hz], false);
      this.chart.setScale("x", { min: end - this.span_s, max: end + 1 });
    });
    this.words.textContent = this.summary();
  }

  get end_ms() {
    const t = this.news?.t_ms;
    return t?.length ? t[t.length - 1] : null;
  }

  summary() {
    const { enf_hz, reference_hz, placed } = this.news;
    const both = enf_hz.map((hz, i) => [hz, reference_hz[i]]).filter(([a, b]) => known(a) && known(b));
    const missing = enf_hz.length && enf_hz.filter(known).length / enf_hz.length;
    const usable = enf_hz.length ? `${Math.round(100 * missing)} % of it usable. ` : "";
    if (!placed) return `${usable}No reference is known for this time.`;
    const where = WHERE[placed.how];
    if (!both.length) return `${usable}Reference ${placed.grid}, ${where}: no values in common yet.`;
    const rms = Math.sqrt(both.reduce((sum, [a, b]) => sum + (a - b) ** 2, 0) / both.length);
    return `${usable}Reference ${placed.grid}, ${where}: ${number(1000 * rms, 2, "mHz")} rms apart.`;
  }

  readOut(at) {
    const { t_ms, enf_hz, std_hz, reference_hz } = this.news;
    if (!known(at) || !known(t_ms[at])) return this.summary();
    const enf = known(enf_hz[at])
      ? `${number(enf_hz[at], 5)} ± ${known(std_hz[at]) ? number(1000 * std_hz[at], 2, "mHz") : "?"}`
      : "no usable value";
    const reference = known(reference_hz[at]) ? `, reference ${number(reference_hz[at], 5, "Hz")}` : "";
    return `${clock(t_ms[at])} UTC: ${enf}${reference}`;
  }

  build() {
    const axis = { stroke: colour("--muted"), grid: { stroke: colour("--line"), width: 1 },
      ticks: { stroke: colour("--line"), width: 1, size: 4 }, font: "11px system-ui" };
    const line = { points: { show: false }, spanGaps: false };
    return new uPlot({
      width: this.parent.clientWidth || 300,
      height: HEIGHT,
      tzDate: (s) => uPlot.tzDate(new Date(1000 * s), "Etc/UTC"),
      padding: [8, 0, 0, 0],
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, points: { size: 5 } },
      scales: { x: { time: true }, y: { range: (_, low, high) => widened(low, high) } },
      axes: [
        { ...axis, space: 70, size: 28, values: (_, splits, __, ___, step) => splits.map((s) => clock(1000 * s).slice(0, step < 60 ? 8 : 5)) },
        { ...axis, size: LEFT, values: (_, splits) => splits.map((hz) => hz.toFixed(3)) },
      ],
      series: [
        {},
        { ...line, stroke: colour("--reference"), width: 4 }, // beneath, so that both are seen
        { ...line, stroke: "transparent" },
        { ...line, stroke: "transparent" },
        { ...line, stroke: colour("--enf"), width: 1.25 },
      ],
      bands: [{ series: [2, 3], fill: colour("--band") }],
      hooks: {
        draw: [(chart) => this.drawBegan(chart)],
        setCursor: [(chart) => (this.words.textContent = this.readOut(chart.cursor.idx))],
      },
    }, [[], [], [], [], []], this.parent);
  }

  // Start of a stream: the camera was restarted or reconnected.
  drawBegan(chart) {
    const { ctx, bbox } = chart;
    ctx.save();
    ctx.strokeStyle = colour("--muted");
    ctx.setLineDash([2, 4]);
    for (const ms of this.began) {
      const x = chart.valToPos(ms / 1000, "x", true);
      if (x < bbox.left || x > bbox.left + bbox.width) continue;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
    }
    ctx.restore();
  }
}

// Range of at least 4 mHz, so that noise isn't magnified.
function widened(low, high) {
  if (!known(low) || !known(high)) return [49.95, 50.05];
  const more = Math.max(0.08 * (high - low), (0.004 - (high - low)) / 2);
  return [low - more, high + more];
}
