"use strict";
// One time for the moving view and for all plots: whoever changes it tells the others.
window.asrsimClock = (() => {
  const listeners = [];
  return {
    time: null,
    set(time, source) {
      this.time = time;
      for (const [listener, own] of listeners) if (own !== source) listener(time);
    },
    listen(source, listener) { listeners.push([listener, source]); },
  };
})();
