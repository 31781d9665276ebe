"""The parts of the view in the browser: scene, marks, motion, page and server; `urdfcal.viewer` puts them together."""
