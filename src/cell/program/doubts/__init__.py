"""Doubts about a program: what a refusal may come from, and paths that go deep into what the tool may touch."""
