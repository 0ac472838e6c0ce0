"""How a mission looks: figures for print, a replay for the browser, an animation."""
