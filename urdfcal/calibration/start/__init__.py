"""Where a fit begins: closed forms, searches, and the mistakes that explain bad data."""
