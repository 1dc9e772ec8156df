"""The style of the page: one column on a phone, tables that scroll, figures that do not break in print."""

CSS = """
:root { color-scheme: light; --ink: #2b2f33; --soft: #5c6269; --rule: #d9dde1; --blue: #1763a6; --tint: #f5f7f9; }
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body { margin: 0 auto; padding: 1rem 1rem 3rem; max-width: 46rem; color: var(--ink); background: #fff;
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto, Helvetica, Arial, sans-serif; }
h1 { font-size: 1.5rem; line-height: 1.25; margin: 0.5rem 0 0.75rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 0.6rem; padding-top: 0.8rem; border-top: 1px solid var(--rule); }
h3 { font-size: 1rem; margin: 1.2rem 0 0.3rem; }
p { margin: 0.4rem 0 0.8rem; }
.verdict { padding: 0.9rem 1rem; background: var(--tint); border-left: 5px solid var(--blue); }
.verdict.nothing-found { border-color: #3a7d44; } .verdict.named { border-color: #3a7d44; }
.verdict.undetermined, .verdict.unexplained { border-color: #d9730d; }
.verdict strong { display: block; font-size: 1.1rem; } .verdict p { margin: 0.3rem 0 0; }
.figures { display: grid; grid-template-columns: repeat(auto-fit, minmax(8.5rem, 1fr)); gap: 0.6rem;
  margin: 1rem 0; }
.figures div { padding: 0.6rem 0.8rem; background: var(--tint); }
.figures b { display: block; font-size: 1.15rem; }
.figures span { color: var(--soft); font-size: 0.85rem; }
.scroll { overflow-x: auto; margin: 0.6rem 0 1rem; }
table { border-collapse: collapse; width: 100%; font-size: 0.88rem; }
caption { text-align: left; color: var(--soft); padding-bottom: 0.3rem; }
th, td { padding: 0.35rem 0.6rem 0.35rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--rule); }
th { color: var(--soft); font-weight: 600; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
tr.named td { font-weight: 600; } tr.faint td { color: var(--soft); }
td:first-child { min-width: 9.5rem; } td:last-child { min-width: 7rem; }
code { font-size: 0.92em; } p code { overflow-wrap: anywhere; } td code { white-space: nowrap; }
figure { margin: 1.2rem 0 1.8rem; } figure svg { display: block; width: 100%; height: auto; }
figcaption, .small { color: var(--soft); font-size: 0.88rem; }
ul { padding-left: 1.2rem; } li { margin: 0.25rem 0; }
footer { margin-top: 2.5rem; padding-top: 0.8rem; border-top: 1px solid var(--rule); }
@media print {
  body { max-width: none; padding: 0; font-size: 10pt; }
  figure, tr, .verdict, .figures div { break-inside: avoid; } h2, h3 { break-after: avoid; }
  figure svg { max-height: 10.5cm; } figure:first-of-type svg { max-height: 17cm; }
  .scroll { overflow: visible; }
  .verdict, .figures div { -webkit-print-color-adjust: exact; print-color-adjust: exact; }
}
""".strip()
