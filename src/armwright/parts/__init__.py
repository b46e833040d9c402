"""The Parts Database: sections, parts, links; materials; the audit."""
