"""How far the present estimate can be trusted: metrics, their judgement, and where the stream breaks off."""
