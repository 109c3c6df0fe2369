"""Documents made from the tables and models: JSON Schemas, AsyncAPI, the reference of all configuration keys."""
