"""The page to play with: a machine, its lossless hop, the family and the return map around it, live in the browser."""
