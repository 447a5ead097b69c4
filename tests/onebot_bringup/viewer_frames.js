// Three frames of 300 ms each and then one as fast as the browser can: of each, how long the one
// before took and how long its own clock and the real one say that 50 ms are; and whether the clock
// ever went back.
const done = arguments[0], found = [];
let before = null, last = performance.now(), backward = false;
function clock() {
  const now = performance.now();
  backward ||= now < last;
  return (last = now);
}
function spin(ms) {
  const start = Date.now();
  while (Date.now() < start + ms) clock();
  return Date.now() - start;
}
function frame(time) {
  const start = clock(), real = spin(50), own = clock() - start;
  if (before !== null) found.push({before: time - before, real, own});
  before = time;
  if (found.length < 3) spin(250);
  if (found.length < 6) requestAnimationFrame(frame);
  else setTimeout(() => { clock(); done({found, backward}); });
}
requestAnimationFrame(frame);
