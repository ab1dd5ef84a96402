"""Three papers as plug-ins of rtstack.experiments: cases, baselines, claims, figures. Nothing else imports them."""
