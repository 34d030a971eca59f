"""What several benches share: peers, and coal's shapes for judges that are apart from the planner."""
