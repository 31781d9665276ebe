"""What a fit or its data are worth: identifiability, predictions, validation, compensation."""
