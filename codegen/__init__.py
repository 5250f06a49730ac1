"""From symbolic laws to C text: graph, passes, names, print."""
