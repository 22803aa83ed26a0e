// The player as a notebook widget.

function hideStill(model) {
  // The still picture beside the player is for pages without a kernel; a rule hides it as long as the player lives.
  const style = document.createElement("style"), name = model.get("_still");
  style.textContent = `.${name}, .jp-OutputArea-child:has(.${name}) { display: none !important; }`;
  document.head.append(style);
  return () => style.remove();
}

function render({ model, el }) {
  const root = document.createElement("div"), player = new Player(root, model), show = hideStill(model);
  el.append(root);
  root.motionkit = player;
  return () => { player.close(); show(); };
}

export default { render };
