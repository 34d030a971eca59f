"""Study files for tests."""
