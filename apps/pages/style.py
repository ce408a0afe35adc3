"""The style sheet inside of every page."""

PAGE_CSS = """
:root { color-scheme: light; --ink: #262c34; --soft: #5d6874; --line: #e2e5e8; --accent: #0072b2; }
* { box-sizing: border-box; }
body {
  margin: 0; background: #f6f7f8; color: var(--ink);
  font: 16px/1.55 system-ui, "Segoe UI", Roboto, "Helvetica Neue", sans-serif;
}
main { max-width: 1080px; margin: 0 auto; padding: 40px 24px 64px; }
h1 { margin: 0 0 4px; font-size: 32px; line-height: 1.2; letter-spacing: -0.01em; }
h2 { margin: 0 0 14px; font-size: 20px; }
header p { margin: 0; color: var(--soft); max-width: 72ch; }
section {
  margin-top: 24px; padding: 22px 24px 24px; background: #fff; border: 1px solid var(--line); border-radius: 10px;
}
p.note, figcaption { margin: 8px 0 0; color: var(--soft); font-size: 14px; line-height: 1.45; }
a { color: var(--accent); }
figure { margin: 0; min-width: 0; }
img { display: block; max-width: 100%; height: auto; border-radius: 6px; }
video { display: block; width: 100%; height: auto; border: 1px solid var(--line); border-radius: 6px; }
.hero { margin-top: 22px; }
.tiles { display: flex; flex-wrap: wrap; gap: 12px; margin: 22px 0 0; padding: 0; list-style: none; }
.tiles li {
  flex: 1 1 150px; padding: 12px 16px; background: #fff; border: 1px solid var(--line); border-radius: 10px;
  color: var(--soft); font-size: 14px;
}
.tiles b {
  display: block; color: var(--ink); font-size: 26px; line-height: 1.25; font-variant-numeric: tabular-nums;
}
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 360px), 1fr)); gap: 22px; }
.pair + .pair, .note + .pair { margin-top: 22px; }
.pair img { width: 100%; }
.strip { display: grid; grid-template-columns: repeat(3, 1fr); gap: 8px; }
.strip img { width: 100%; }
.strip figcaption { margin-top: 2px; font-variant-numeric: tabular-nums; }
.scroll { overflow-x: auto; }
.stack { display: grid; gap: 18px; align-content: start; }
table { width: 100%; border-collapse: collapse; font-size: 14px; font-variant-numeric: tabular-nums; }
th {
  padding: 6px 14px 6px 0; border-bottom: 2px solid var(--line); color: var(--soft); font-size: 13px;
  font-weight: 600; text-align: left; white-space: nowrap;
}
td { padding: 7px 12px 7px 0; border-bottom: 1px solid var(--line); white-space: nowrap; }
td.wide { white-space: normal; }
td b { font-weight: 600; }
th.n, td.n { text-align: right; }
tr:last-child td { border-bottom: 0; }
.chart { display: block; width: 100%; height: auto; font-size: 13px; }
.rose { max-width: 320px; margin: 0 auto; }
.chart text { fill: var(--soft); }
.grid { stroke: var(--line); stroke-width: 1; }
.track { fill: #eceef0; }
.rate { width: 120px; height: 16px; vertical-align: middle; }
h3 { margin: 16px 0 6px; font-size: 15px; }
h3:first-child { margin-top: 0; }
.rates {
  display: grid; grid-template: "name bar value" / 110px 1fr 64px; gap: 2px 12px; align-items: center; margin: 6px 0;
}
.rates span { grid-area: name; }
.rates b { grid-area: value; font-size: 17px; text-align: right; white-space: nowrap; }
.own { color: var(--accent); }
.meter { grid-area: bar; position: relative; height: 16px; background: #eceef0; border-radius: 4px; }
.meter i { position: absolute; inset: 0 auto 0 0; border-radius: 4px; background: #9aa3ad; }
.own .meter i { background: var(--accent); }
.meter u { position: absolute; top: 7px; height: 2px; background: var(--ink); opacity: 0.7; }
.legend {
  display: flex; flex-wrap: wrap; gap: 4px 16px; margin: 0 0 8px; padding: 0; list-style: none; font-size: 14px;
}
.legend i { display: inline-block; width: 11px; height: 11px; margin-right: 6px; border-radius: 50%; }
details { margin-top: 14px; }
summary { color: var(--accent); cursor: pointer; font-size: 14px; }
details[open] summary { margin-bottom: 8px; }
pre {
  margin: 4px 0 14px; padding: 10px 14px; white-space: pre-wrap; overflow-wrap: anywhere;
  background: #f3f5f7; border-radius: 6px;
  font: 14px/1.5 ui-monospace, "SF Mono", Consolas, monospace;
}
pre:last-child { margin-bottom: 0; }
.what { font-size: 15px; }
footer { margin-top: 28px; color: var(--soft); font-size: 13px; overflow-wrap: anywhere; }
footer dl { display: grid; grid-template-columns: max-content 1fr; gap: 2px 16px; margin: 0; }
footer dd { margin: 0; }
@media (max-width: 640px) {
  main { padding: 24px 12px 40px; }
  h1 { font-size: 26px; }
  section { padding: 16px 14px 18px; }
  .tiles li { flex-basis: 130px; padding: 10px 12px; }
  .strip { grid-template-columns: repeat(2, 1fr); }
  .rates { grid-template: "name value" "bar bar" / 1fr max-content; }
  thead { display: none; }
  tr { display: block; padding: 8px 0; border-bottom: 1px solid var(--line); }
  td { display: flex; justify-content: space-between; gap: 16px; padding: 2px 0; border: 0; white-space: normal; }
  td, th.n, td.n { text-align: right; }
  td::before { content: attr(data-name); color: var(--soft); text-align: left; }
  td:empty { display: none; }
  footer dl { display: block; }
  footer dd { margin-bottom: 6px; }
}
"""
