"""The dispatch page: what is heard of trains, as a person sees it, and the page in a browser."""
