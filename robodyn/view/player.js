// Play, pause, loop, speed and the time slider; and `window.robodyn`, the same for scripts.

function startPlayer({ viewer, follow }) {
  const slider = byId("time"), clock = byId("clock"), play = byId("play"), loop = byId("loop"), speed = byId("speed");
  const digits = Math.min(6, Math.max(1, 3 - Math.floor(Math.log10(end - start || 1))));
  let time = start, playing = false, looping = true, held = false;

  function setTime(t) {
    time = Math.min(end, Math.max(start, t));
    moveLinks(time);
    follow();
    slider.value = time;
    clock.value = `${time.toFixed(digits)} / ${end.toFixed(digits)} s`;
    slider.setAttribute("aria-valuetext", `${time.toFixed(digits)} seconds`);
    viewer.set_dirty();
  }

  function setPlaying(on) {
    if (on === playing || end === start) return;
    playing = on;
    play.classList.toggle("playing", on);
    play.setAttribute("aria-label", on ? "Pause" : "Play");
    play.title = `${on ? "Pause" : "Play"} (space)`;
    if (!on) return;
    if (time >= end) setTime(start);
    requestAnimationFrame(now => tick(now, now));
  }

  // One picture; a page that was asleep goes on where it stopped.
  function tick(before, now) {
    if (!playing) return;
    const t = time + (held ? 0 : Math.min(now - before, 500) / 1000 * speed.value);
    if (t < end) setTime(t);
    else if (looping) setTime(start + (t - end) % (end - start));
    else { setTime(end); setPlaying(false); }
    requestAnimationFrame(next => tick(now, next));
  }

  // World matrix of a link, row after row, as the scene holds it.
  function linkPose(name) {
    const link = links.find(candidate => candidate.name === name);
    link.updateWorldMatrix(true, false);
    return viewer.scene.matrixWorld.clone().invert().multiply(link.matrixWorld).transpose().toArray();
  }

  Object.assign(slider, { min: start, max: end });
  slider.addEventListener("input", () => setTime(slider.valueAsNumber));
  slider.addEventListener("pointerdown", () => { held = true; });
  for (const name of ["pointerup", "pointercancel"]) slider.addEventListener(name, () => { held = false; });
  play.addEventListener("click", () => setPlaying(!playing));
  byId("restart").addEventListener("click", () => setTime(start));
  loop.addEventListener("click", () => {
    looping = !looping;
    loop.setAttribute("aria-pressed", looping);
  });
  document.addEventListener("keydown", event => {
    if (event.code !== "Space" || event.target.closest("button, select")) return;
    event.preventDefault();
    setPlaying(!playing);
  });

  setTime(start);
  window.robodyn = { times, setTime, linkPose, play: () => setPlaying(true), pause: () => setPlaying(false) };
}

if (webglWorks()) {
  byId("controls").hidden = end === start;
  startPlayer(openStage());
} else {
  byId("frame").hidden = byId("follow").hidden = true;
  byId("failure").hidden = false;
  byId("failure").textContent = "This page draws the robot with WebGL, which this browser does not offer. "
    + "Switch hardware acceleration on in its settings, or open the file in another browser.";
}
