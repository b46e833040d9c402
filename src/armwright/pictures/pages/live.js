// Keeps an arm's page in step with the program that serves it: goes to its poses, plays its motions, reports the sliders.
"use strict";

const MOST_LOOKED_AT = 60; // rows of a motion, which tell how much room it needs

// poser: the page's arm.   page: its number; the program counts on where it has another arm to show.
function follow(poser, page) {
  const status = poser.at("live"), me = Math.random().toString(36).slice(2);
  const say = (text, ended) => { status.textContent = text; status.className = ended ? "ended" : ""; status.hidden = false; };
  let frame = 0, reporting = false, again = false;

  // Keeps these poses in the picture.
  const room = (poses) => {
    for (const q of poses) {
      poser.q = q;
      poser.stage.include(poser.gltf.boxes(poser.world()));
    }
  };

  // t: [s] (k,); q: (k, n), between whose rows the arm moves evenly.
  const play = ({ t, q }) => {
    const start = performance.now(), last = t.length - 1;
    room(q.filter((_, i) => i % Math.ceil(q.length / MOST_LOOKED_AT) === 0));
    let k = 0;
    const step = (now) => {
      const seconds = t[0] + Math.max(now - start, 0) / 1000;
      while (k < last && t[k + 1] <= seconds) k++;
      const part = k < last ? (seconds - t[k]) / (t[k + 1] - t[k]) : 0;
      poser.go(q[k].map((v, i) => (part ? v + part * (q[k + 1][i] - v) : v)));
      say(`live, t = ${fixed(Math.min(seconds, t[last]), 2)} s`);
      if (k < last) frame = requestAnimationFrame(step);
    };
    frame = requestAnimationFrame(step);
  };

  // One report at a time; of poses that come meanwhile the last one is sent.
  const report = async () => {
    cancelAnimationFrame(frame);
    again = true;
    if (reporting) return;
    reporting = true;
    while (again) {
      again = false;
      await fetch("q", { method: "POST", body: JSON.stringify({ q: poser.q, from: me }) }).catch(() => {});
    }
    reporting = false;
  };
  poser.at("sliders").addEventListener("input", report);
  for (const id of ["start", "zero"]) poser.at(id).addEventListener("click", report);

  const source = new EventSource("events");
  source.onopen = () => say("live");
  source.onerror = () => say("the program has ended", true);
  source.onmessage = ({ data }) => {
    const news = JSON.parse(data);
    if (news.page !== page) { source.close(); location.reload(); return; }
    if (news.from === me) return;
    cancelAnimationFrame(frame);
    if (news.t) { play(news); return; }
    room([news.q]);
    poser.go(news.q);
    say("live");
  };
}
