"""How a study is computed: in parts, by processes, each point by the stages that it passes."""
