// In the language of old browsers, which cannot read the other programs of the page.
(function () {
  if (window.asrsimCharts) return;
  var words = document.createElement("p"), main = document.querySelector("main");
  words.className = "bad";
  words.textContent = "The plots and the moving robot need a newer browser (of 2021 or later). All numbers are on the page.";
  main.insertBefore(words, main.firstChild);
})();
