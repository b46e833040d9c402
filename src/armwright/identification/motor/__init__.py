"""White-box identification of drives: parameters of the record by simulation error."""
